//! Who is asked about a gap: regressions on different features, in different local frames.

use super::features::Part;

/// Which markers make the local frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Base {
    /// So many of the marker's best neighbours.
    Nearest(usize),
    /// The markers that keep together best in the whole body, whatever the gap.
    Trunk,
}

/// A regression.
#[derive(Clone, Debug, PartialEq)]
pub struct Spec {
    /// Its name for people.
    pub name: &'static str,
    /// What it looks at.
    pub parts: Vec<Part>,
    /// Standard deviation of its coefficients before anything was seen.
    pub prior: f64,
}

/// Regressions that share a local frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Family {
    /// The frame.
    pub base: Base,
    /// The regressions.
    pub specs: Vec<Spec>,
}

/// What the gap is like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Situation {
    /// A first look, to be repeated.
    Draft,
    /// A second look, to be repeated: fewer experts do nearly as well.
    Sketch,
    /// The marker's rigid neighbours are there, some of them filled: of many gaps each gets the experts that carry most.
    Crowded,
    /// The marker's rigid neighbours are there and were seen.
    Plain,
    /// Some of them are missing with it.
    Limb,
}

impl Situation {
    /// Errors in real gaps against those on simulated ones, measured over several hundred gaps of takes with known truth.
    /// Whole blocks around simulated gaps are kept from being learned, which makes them harder than real ones;
    /// but in their surroundings nothing is filled, which makes them easier than real ones among others.
    pub fn pessimism(self) -> f64 {
        match self {
            Self::Plain => 0.85,
            Self::Draft | Self::Sketch | Self::Crowded | Self::Limb => 0.95,
        }
    }
}

/// How many neighbours "all" is.
pub const ALL: usize = 40;

fn spec(name: &'static str, prior: f64, parts: &[Part]) -> Spec {
    Spec { name, parts: parts.to_vec(), prior }
}

fn near(neighbours: usize, poses: usize, turn: bool) -> Part {
    Part::Near { neighbours, poses, turn }
}

/// The experts for a gap.
///
/// Few neighbours and a bent view of them carry most; the rest is there for gaps where these fail, and the evidence decides.
pub fn families(situation: Situation) -> Vec<Family> {
    use Part::{Acceleration, Bumps, Drift, Place, Products, Turn, TurnRate, Velocity};
    let mut five = vec![spec("linear8", 0.3, &[Place(8)]), spec("linear14", 0.3, &[Place(14)])];
    if situation == Situation::Draft {
        five.insert(0, spec("rigid", 1.0, &[]));
        five.insert(1, spec("linear4", 0.3, &[Place(4)]));
        return vec![Family { base: Base::Nearest(5), specs: five }];
    }
    if situation == Situation::Sketch {
        five.extend([
            spec("moving4", 0.3, &[Place(4), Velocity(4, 8), Acceleration(4, 8)]),
            spec("process5", 0.3, &[Place(5), near(5, 40, false)]),
        ]);
        return vec![
            Family { base: Base::Nearest(5), specs: five },
            Family { base: Base::Nearest(3), specs: vec![spec("linear8", 0.3, &[Place(8)])] },
        ];
    }
    five.extend([
        spec("moving4", 0.3, &[Place(4), Velocity(4, 8), Acceleration(4, 8)]),
        spec("process5", 0.3, &[Place(5), near(5, 40, false)]),
        spec("turning4", 0.3, &[Place(4), Turn, Drift(8)]),
    ]);
    if situation != Situation::Crowded {
        five.extend([spec("products4", 0.3, &[Place(4), Products(4)]), spec("process8", 0.3, &[Place(8), near(8, 40, false)])]);
    }
    let mut three = vec![spec("linear8", 0.3, &[Place(8)])];
    let mut ten = vec![spec("linear8", 0.3, &[Place(8)]), spec("products4", 0.3, &[Place(4), Products(4)])];
    let mut families = Vec::new();
    if situation == Situation::Limb {
        five.extend([
            spec("process8-turned", 0.3, &[Place(8), Turn, near(8, 80, true)]),
            spec("process-all-turned", 0.3, &[Place(ALL), Turn, near(ALL, 80, true)]),
            spec("turning8", 0.3, &[Place(8), Turn, TurnRate(8), Drift(8), Velocity(8, 8)]),
            spec("products6", 0.3, &[Place(6), Products(6)]),
            spec("delayed24", 0.3, &[Place(24), Bumps { neighbours: 24, poses: 40, lag: 16 }]),
            spec("bumps14", 0.3, &[Place(14), Bumps { neighbours: 14, poses: 40, lag: 0 }]),
        ]);
        three.push(spec("products4-turned", 0.3, &[Place(4), Products(4), Turn]));
        ten.push(spec("turning8", 0.3, &[Place(8), Turn, Drift(8)]));
        families.push(Family {
            base: Base::Trunk,
            specs: vec![
                spec("moving24", 0.1, &[Place(24), Velocity(24, 8), Acceleration(24, 8)]),
                spec("linear-all", 0.3, &[Place(ALL)]),
                spec("process24-turned", 0.3, &[Place(24), Turn, near(24, 80, true)]),
            ],
        });
    }
    families.push(Family { base: Base::Nearest(5), specs: five });
    families.push(Family { base: Base::Nearest(3), specs: three });
    families.push(Family { base: Base::Nearest(10), specs: ten });
    families
}
