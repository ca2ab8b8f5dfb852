//! Gauss-Newton steps, damped and halved (section 3.2.1, algorithm 1 without its misprints).

use super::normal::Normal;
use super::pose::{Pose, Posed};
use super::terms::{At, Term};
use super::tree::Tree;

/// How steps are damped and when they end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// The most steps.
    pub iterations: u32,
    /// The most halvings of one step.
    pub halvings: u32,
    /// What is added to the diagonal (the report's epsilon, 0.1): it is there for what nobody sees.
    pub damping: f64,
    /// The share of the diagonal that is added to it (Marquardt); it grows and shrinks with how well steps were predicted.
    pub marquardt: f64,
    /// A decrease of the energy by less than this share of it is the end.
    pub tolerance: f64,
}

impl Default for Rules {
    fn default() -> Self {
        Self { iterations: 20, halvings: 8, damping: 0.1, marquardt: 0.0, tolerance: 1e-6 }
    }
}

/// How it ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Solved {
    /// The energy of the pose.
    pub energy: f64,
    /// Steps taken.
    pub iterations: u32,
    /// True if the energy had ceased to fall.
    pub settled: bool,
}

/// The share that Marquardt's damping begins with again if a step failed without any.
const MARQUARDT_AGAIN: f64 = 1e-4;

/// Solves for poses of one tree, again and again, in the same memory.
#[derive(Clone, Debug)]
pub struct GaussNewton {
    /// The equations of the last step.
    pub normal: Normal,
    posed: Posed,
    tried: Posed,
    step: Vec<f64>,
}

impl GaussNewton {
    /// For poses of `tree`.
    pub fn new(tree: &Tree) -> Self {
        Self { normal: Normal::new(tree), posed: Posed::new(tree), tried: Posed::new(tree), step: vec![0.0; tree.freedom()] }
    }

    /// Where the last pose puts the body.
    pub fn posed(&self) -> &Posed {
        &self.posed
    }

    /// Changes `pose` until the energy of all terms no longer falls.
    pub fn solve(&mut self, tree: &Tree, terms: &[&dyn Term], pose: &mut Pose, rules: &Rules) -> Solved {
        self.posed.set(tree, pose);
        let energy = |pose: &Pose, posed: &Posed| terms.iter().map(|term| term.energy(&At { tree, pose, posed })).sum::<f64>();
        let mut solved = Solved { energy: energy(pose, &self.posed), ..Solved::default() };
        let mut marquardt = rules.marquardt;
        let mut tried = pose.clone();
        while solved.iterations < rules.iterations {
            self.normal.clear();
            for term in terms {
                term.add(&At { tree, pose, posed: &self.posed }, &mut self.normal);
            }
            self.normal.gather(tree, &self.posed);
            solved.iterations += 1;
            if !self.normal.step(|diagonal| rules.damping + marquardt * diagonal, &mut self.step) {
                marquardt = (marquardt * 10.0).max(MARQUARDT_AGAIN);
                continue;
            }
            let before = solved.energy;
            let mut scale = 1.0;
            for _ in 0..=rules.halvings {
                tried.clone_from(pose);
                tried.update(tree, &self.step, scale);
                self.tried.set(tree, &tried);
                let energy = energy(&tried, &self.tried);
                if energy < before {
                    std::mem::swap(pose, &mut tried);
                    std::mem::swap(&mut self.posed, &mut self.tried);
                    solved.energy = energy;
                    break;
                }
                scale *= 0.5;
            }
            let fell = before - solved.energy;
            if fell <= rules.tolerance * before {
                solved.settled = true;
                break;
            }
            if rules.marquardt > 0.0 {
                let promised: f64 = -self.step.iter().zip(self.normal.gradient()).map(|(s, g)| s * g).sum::<f64>() * scale;
                marquardt *= if fell > 0.75 * promised {
                    0.3
                } else if fell < 0.25 * promised {
                    4.0
                } else {
                    1.0
                };
            }
        }
        solved
    }
}
