#![allow(clippy::unwrap_used)]
use super::*;
use crate::random::Random;
use crate::solve::ik::tests::{direction, point, pose, tree};
use crate::solve::ik::tree::Motion;
use crate::solve::ik::{Normal, Vec3};
use formats::rig::Limit;
use nalgebra::DMatrix;

fn pairs(tree: &Tree, random: &mut Random) -> &'static [Pair] {
    let pairs: Vec<Pair> = (0..40)
        .map(|_| Pair {
            part: random.whole(0, tree.joints()) as u32,
            vertex: point(random, 60.0),
            normal: direction(random),
            point: point(random, 60.0),
            weight: random.between(0.0, 1.0),
        })
        .collect();
    pairs.leak()
}

fn limits(tree: &Tree, random: &mut Random, swing_twist: bool) -> Box<dyn Term> {
    let limit = |random: &mut Random, motion| match motion {
        Motion::Translate => Limit::Translate { farthest: [0.1, 0.2, 0.3] },
        Motion::Revolute(_) => Limit::Revolute { least: -0.1, most: 0.1 },
        Motion::Ball => {
            Limit::Ball { heading: direction(random).into(), heading_most: 0.1, bank: direction(random).into(), bank_most: 0.2 }
        }
    };
    let limits: Vec<_> = tree.links.iter().map(|link| Some(limit(random, link.motion))).collect();
    let mut limits = Limits::new(&limits, swing_twist, 1.0);
    for (_, _, weight) in &mut limits.bounds {
        *weight = random.between(0.5, 2.0);
    }
    Box::new(limits)
}

type Example = fn(&Tree, &mut Random) -> Box<dyn Term>;

/// An example of every term.
const ALL: &[(&str, Example)] = &[
    ("Markers", |tree, random| {
        let marker =
            |random: &mut Random| Marker { part: random.whole(0, tree.joints()), vertex: point(random, 60.0), offset: point(random, 2.0) };
        Box::new(Markers { seen: (0..10).map(|_| (marker(random), point(random, 60.0), random.between(0.0, 2.0))).collect() })
    }),
    ("Points<'_>", |tree, random| Box::new(Points { pairs: pairs(tree, random) })),
    ("Planes<'_>", |tree, random| Box::new(Planes { pairs: pairs(tree, random), along: 0.1 })),
    ("Limits", |tree, random| limits(tree, random, false)),
    ("Limits", |tree, random| limits(tree, random, true)),
    ("Pull", |tree, random| {
        Box::new(Pull { towards: pose(tree, random), weights: (0..tree.freedom()).map(|_| random.between(0.0, 2.0)).collect() })
    }),
    ("Prior", |tree, random| {
        let root = DMatrix::from_fn(5, tree.freedom(), |_, _| random.between(-1.0, 1.0));
        Box::new(Prior { usual: pose(tree, random), root })
    }),
];

/// The files of this folder: solvers know no files, so they are compiled in.
const FILES: &[(&str, &str)] = &[
    ("cloud", include_str!("cloud.rs")),
    ("limits", include_str!("limits.rs")),
    ("markers", include_str!("markers.rs")),
    ("pull", include_str!("pull.rs")),
    ("tests", ""),
];

#[test]
fn all_terms_are_in_the_list() {
    let folder = include_str!("mod.rs");
    let modules: Vec<&str> = folder.lines().filter_map(|line| line.strip_prefix("mod ")?.strip_suffix(';')).collect();
    assert_eq!(modules, FILES.iter().map(|(name, _)| *name).collect::<Vec<_>>(), "FILES has every module of mod.rs");
    let texts = FILES.iter().map(|(_, text)| *text).chain([folder]);
    let terms = texts.flat_map(str::lines).filter_map(|line| Some(line.strip_prefix("impl Term for ")?.strip_suffix(" {")?.to_owned()));
    let found: std::collections::BTreeSet<String> = terms.collect();
    let listed: std::collections::BTreeSet<String> = ALL.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert!(found.len() >= 6);
    assert_eq!(found, listed);
}

/// `JᵀJ` and `Jᵀr` of every term against differences of its residuals.
#[test]
fn terms_know_their_derivatives() {
    for (name, example) in ALL {
        for seed in 0..12 {
            let (tree, mut random) = tree(seed);
            let term = example(&tree, &mut random);
            let pose = pose(&tree, &mut random);
            let mut posed = Posed::new(&tree);
            let mut residuals = |pose: &Pose| {
                posed.set(&tree, pose);
                let mut residuals = Vec::new();
                term.residuals(&At { tree: &tree, pose, posed: &posed }, &mut residuals);
                residuals
            };
            let here = residuals(&pose);
            let columns: Vec<Vec<f64>> = (0..tree.freedom())
                .map(|dof| {
                    let mut at = |by: f64| {
                        let mut step = vec![0.0; tree.freedom()];
                        step[dof] = by;
                        let mut moved = pose.clone();
                        moved.update(&tree, &step, 1.0);
                        residuals(&moved)
                    };
                    let (after, before) = (at(1e-6), at(-1e-6));
                    after.iter().zip(&before).map(|(a, b)| (a - b) / 2e-6).collect()
                })
                .collect();
            posed.set(&tree, &pose);
            let at = At { tree: &tree, pose: &pose, posed: &posed };
            let mut normal = Normal::new(&tree);
            term.add(&at, &mut normal);
            normal.gather(&tree, &posed);
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            for row in 0..tree.freedom() {
                let close = |a: f64, b: f64, size: f64| (a - b).abs() < 1e-4 * size.max(1.0);
                let expected = dot(&columns[row], &here);
                let size = dot(&columns[row], &columns[row]).sqrt() * dot(&here, &here).sqrt();
                let told = normal.gradient()[row];
                assert!(close(told, expected, size), "{name}, seed {seed}, gradient {row}: {told} for {expected}");
                for column in 0..=row {
                    let expected = dot(&columns[row], &columns[column]);
                    let size = (dot(&columns[row], &columns[row]) * dot(&columns[column], &columns[column])).sqrt();
                    let told = normal.entry(row, column);
                    assert!(close(told, expected, size), "{name}, seed {seed}, entry {row} {column}: {told} for {expected}");
                }
            }
            let energy = term.energy(&at);
            assert!((energy - dot(&here, &here)).abs() <= 1e-9 * energy, "{name}: energy");
        }
    }
}

#[test]
fn limits_hold_where_a_limb_has_turned_around() {
    let (tree, _) = tree(1);
    let ball = tree.links.iter().position(|link| link.motion == Motion::Ball).unwrap();
    let limits = Limits { bounds: vec![(ball, Bound::Cone { direction: Vec3::y(), most: 1.0 }, 1.0)] };
    let mut pose = Pose::reference(&tree);
    let mut update = vec![0.0; tree.freedom()];
    update[tree.links[ball].first] = std::f64::consts::PI;
    pose.update(&tree, &update, 1.0);
    let mut posed = Posed::new(&tree);
    posed.set(&tree, &pose);
    let mut normal = Normal::new(&tree);
    limits.add(&At { tree: &tree, pose: &pose, posed: &posed }, &mut normal);
    let pull: f64 = normal.gradient().iter().map(|g| g * g).sum::<f64>().sqrt();
    assert!((pull - (std::f64::consts::PI - 1.0)).abs() < 1e-9, "{pull}");
}
