//! `mocap-repair track`: what can be typed, and what it asks for.

use super::args::{positive, rate, share};
use super::rig::{RigArgs, order};
use crate::compression;
use crate::solve::track::{Method, Settings};
use crate::track::{Pattern, Request};
use clap::{Args, ValueEnum};
use formats::bvh::Order;
use std::path::PathBuf;

pub(super) const AFTER_HELP: &str = "\
Exit codes:
  0  every frame was followed
  1  failed; no output was written
  2  the command line was wrong
  3  the output exists, but look at it: frames had no cloud, a part of the body was lost,
     something was assumed, or there is no log";

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum MethodArg {
    /// Distances from the planes of the surface, with limits, prediction, and a search for lost limbs
    Planes,
    /// As Kineben's report has it
    Report,
}

/// `mocap-repair track`.
#[derive(Debug, Args)]
#[command(mut_arg("cst_unit", |arg| arg.requires("cst")), mut_arg("cst_ball", |arg| arg.requires("cst")))]
#[allow(clippy::struct_excessive_bools)] // each is a switch that somebody types
pub(super) struct TrackArgs {
    /// The clouds, one file for each frame: %d or %03d stands for its number
    #[arg(value_name = "CLOUDS_%03d.off", value_parser = Pattern::parse)]
    clouds: Pattern,
    #[command(flatten)]
    rig: RigArgs,
    /// The BVH file to write; .zst behind its name compresses it
    #[arg(short, long, value_name = "OUT.bvh")]
    output: PathBuf,
    /// The first frame [default: the first one that has a file]
    #[arg(long, value_name = "FRAME")]
    first: Option<u32>,
    /// The last frame [default: the last one that has a file]
    #[arg(long, value_name = "FRAME")]
    last: Option<u32>,
    /// Frames per second, which clouds do not say
    #[arg(long, value_name = "HZ", default_value_t = 30.0, value_parser = rate)]
    fps: f64,
    /// How the body is followed
    #[arg(long, value_enum, default_value = "planes")]
    method: MethodArg,
    /// How far from the surface points may be at the beginning of a frame: standard deviation, in cm [default: 4]
    #[arg(long, value_name = "CM", value_parser = positive)]
    sigma0: Option<f64>,
    /// The least cosine of the angle between the normals of a point and of the surface [default: 0.6]
    #[arg(long, value_name = "COSINE", value_parser = cosine, allow_negative_numbers = true, conflicts_with = "normal_angle")]
    nthresh: Option<f64>,
    /// The same as the largest angle, in degrees
    #[arg(long, value_name = "DEG", value_parser = angle)]
    normal_angle: Option<f64>,
    /// How readily points are left out that belong to nothing: more leaves out more [default: 0.1]
    #[arg(long, value_name = "WEIGHT", value_parser = share)]
    eoutlier: Option<f64>,
    /// Rounds of EM for each frame [default: 12, with --method report 10]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: Option<u32>,
    /// Order of the rotation channels in the BVH file
    #[arg(long, default_value = "zyx", value_parser = order(), ignore_case = true)]
    order: Order,
    /// The table of frames [default: the output's name with .frames.csv]
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// The log for Foxglove or Lichtblick [default: the output's name with .mcap]
    #[arg(long, value_name = "FILE.mcap", conflicts_with = "no_log")]
    log: Option<PathBuf>,
    /// Write no log
    #[arg(long)]
    no_log: bool,
    /// Show at most so many frames per second in the log's clouds and skeleton
    #[arg(long, value_name = "HZ", value_parser = positive, conflicts_with = "no_log")]
    log_rate: Option<f64>,
    /// Write a report to look at: one HTML file with player and curves, for any browser
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Replace files that exist
    #[arg(long)]
    force: bool,
    /// Read the body and the first cloud, check all names and tell what would be done; follow and write nothing
    #[arg(long)]
    dry_run: bool,
    /// Report as JSON lines on standard output
    #[arg(long)]
    pub json: bool,
    /// Print nothing unless it failed
    #[arg(short, long)]
    pub quiet: bool,
}

fn cosine(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (-1.0..1.0).contains(&x) => Ok(x),
        _ => Err("expected a number from -1 to 1".to_owned()),
    }
}

fn angle(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x <= 180.0 => Ok(x),
        _ => Err("expected an angle above 0 and at most 180".to_owned()),
    }
}

impl TrackArgs {
    /// What is wrong with what was typed, if that shows without a look at files.
    pub fn contradiction(&self) -> Option<String> {
        let (first, last) = (self.first?, self.last?);
        (first > last).then(|| format!("--first {first} is behind --last {last}; the first frame comes first"))
    }

    pub fn request(&self) -> Request {
        let usual = Settings::of(match self.method {
            MethodArg::Planes => Method::Planes,
            MethodArg::Report => Method::Report,
        });
        let sigma0_cm = self.sigma0.unwrap_or(usual.sigma0_cm);
        let settings = Settings {
            sigma0_cm,
            sigma_end_cm: usual.sigma_end_cm.min(sigma0_cm),
            cosine: self.nthresh.or(self.normal_angle.map(|angle| angle.to_radians().cos())).unwrap_or(usual.cosine),
            outlier: self.eoutlier.unwrap_or(usual.outlier),
            rounds: self.rounds.unwrap_or(usual.rounds),
            ..usual
        };
        let named = |extension: &str| compression::inner_name(&self.output).with_extension(extension);
        Request {
            clouds: self.clouds.clone(),
            first: self.first,
            last: self.last,
            rig: self.rig.files(),
            settings,
            rate_hz: self.fps,
            order: self.order,
            output: self.output.clone(),
            table: self.csv.clone().unwrap_or_else(|| named("frames.csv")),
            log: (!self.no_log).then(|| self.log.clone().unwrap_or_else(|| named("mcap"))),
            log_rate_hz: self.log_rate,
            page: self.report.clone(),
            force: self.force,
            dry_run: self.dry_run,
        }
    }
}
