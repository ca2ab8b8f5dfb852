//! What can be typed about a body with a skeleton, for all commands that have one.

use crate::rig::wearer::WearerFiles;
use crate::rig::{Length, RigFiles};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use formats::bvh::Order;
use formats::rig::AngleUnit;
use std::path::PathBuf;

/// The files of a body, and what they do not say.
///
/// Which of them are needed is for the command to say: here the first three are.
#[derive(Debug, Args)]
pub(super) struct RigArgs {
    /// The skeleton: joints, how they move, and where they are in the reference pose; a BVH file will do
    #[arg(long, value_name = "FILE.skl", required = true)]
    skl: Option<PathBuf>,
    /// The surface of the body in the reference pose
    #[arg(long, value_name = "FILE.off", required = true)]
    off: Option<PathBuf>,
    /// Which joint moves which vertex of the surface
    #[arg(long, value_name = "FILE.vj", required = true)]
    vj: Option<PathBuf>,
    /// How far joints move; without it they move as far as they like
    #[arg(long, value_name = "FILE.cst")]
    cst: Option<PathBuf>,
    /// Unit of length of the files of the body, and of clouds [default: by the size of the body]
    #[arg(long, value_enum)]
    unit: Option<UnitArg>,
    /// Unit of the angles of --cst [default: deg if one of them is more than a whole turn of rad, else rad]
    #[arg(long, value_enum, value_name = "UNIT")]
    cst_unit: Option<AngleArg>,
    /// What the second angle of a ball joint in --cst limits: how far its second direction tilts, or how far the limb turns about itself
    #[arg(long, value_enum, default_value = "cones", value_name = "HOW")]
    cst_ball: BallArg,
    /// Give the trunk a joint more, between its lower and upper limbs, so that it bends; the output has that joint, too
    #[arg(long)]
    spine: bool,
}

impl RigArgs {
    pub fn files(&self) -> RigFiles {
        RigFiles {
            skeleton: self.skl.clone().unwrap_or_default(),
            surface: self.off.clone().unwrap_or_default(),
            parts: self.vj.clone().unwrap_or_default(),
            limits: self.cst.clone(),
            unit: self.unit.map(|unit| match unit {
                UnitArg::Mm => Length::Millimetre,
                UnitArg::Cm => Length::Centimetre,
                UnitArg::M => Length::Metre,
                UnitArg::In => Length::Inch,
            }),
            angles: self.cst_unit.map(|unit| match unit {
                AngleArg::Deg => AngleUnit::Degree,
                AngleArg::Rad => AngleUnit::Radian,
            }),
            swing_twist: self.cst_ball == BallArg::SwingTwist,
            spine: self.spine,
        }
    }
}

/// The files of a body, and where it wears markers.
#[derive(Debug, Args)]
pub(super) struct WearerArgs {
    #[command(flatten)]
    rig: RigArgs,
    /// Where the markers sit on the body (CSV: marker,vertex,joint[,x,y,z,weight])
    #[arg(long, value_name = "FILE.csv", required = true)]
    map: Option<PathBuf>,
}

impl WearerArgs {
    /// With or without a map; `calibrate` says whether to find out where markers sit.
    pub fn files(&self, calibrate: bool) -> WearerFiles {
        WearerFiles { rig: self.rig.files(), map: self.map.clone(), calibrate }
    }

    /// True if a map is named.
    pub fn has_map(&self) -> bool {
        self.map.is_some()
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum UnitArg {
    Mm,
    Cm,
    M,
    In,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum AngleArg {
    Deg,
    Rad,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum BallArg {
    Cones,
    SwingTwist,
}

/// Named one by one, so that help and shells know them.
pub(super) fn order() -> impl TypedValueParser<Value = Order> {
    let known = |name: &str| Order::ALL.into_iter().find(|order| order.name().eq_ignore_ascii_case(name));
    PossibleValuesParser::new(["xyz", "xzy", "yxz", "yzx", "zxy", "zyx"]).try_map(move |name| known(&name).ok_or("no order of this name"))
}
