//! `mocap-repair solve`: what can be typed, and what it asks for.

use super::args::{StatedArgs, positive};
use super::rig::{WearerArgs, order};
use crate::compression;
use crate::fit::Request;
use crate::solve::markers::Settings;
use clap::Args;
use formats::bvh::Order;
use std::path::PathBuf;

pub(super) const AFTER_HELP: &str = "\
The map is CSV with a header: marker,vertex,joint and, if need be, x,y,z,weight.
A marker sits on a vertex of the surface (counted from 0) and moves with the joint;
x,y,z lead from the vertex to the marker, or are its place in the reference pose if
there is no vertex. Without a joint it moves with the vertex. A joint alone
(marker,joint) will do with --calibrate.

Exit codes:
  0  every joint was seen, and none for so long not that its place is a guess:
     0.2 s for joints that carry others, 0.5 s for heads, hands and feet
  1  failed; no output was written
  2  the command line was wrong
  3  the output exists, but look at it: frames had no marker, nothing tells of a joint (for long),
     the map names markers that the take does not have or never shows, markers are far
     from their places, the best size is the last one tried, something was assumed, or
     there is no log; the report says which, with --json in look_at";

/// `mocap-repair solve`.
#[derive(Debug, Args)]
#[allow(clippy::struct_excessive_bools)] // each is a switch that somebody types
#[command(mut_arg("map", |arg| arg.required(false).required_unless_present("calibrate")), mut_arg("cst_unit", |arg| arg.requires("cst")), mut_arg("cst_ball", |arg| arg.requires("cst")))]
pub(super) struct SolveArgs {
    /// The take with labelled markers
    #[arg(value_name = "MARKERS")]
    input: PathBuf,
    #[command(flatten)]
    wearer: WearerArgs,
    /// Find out from the take itself where the markers sit and how long the bones are. Without --map, the label of a marker has to begin with the
    /// name of the joint that moves it
    #[arg(long)]
    calibrate: bool,
    /// The BVH file to write; .zst behind its name compresses it
    #[arg(short, long, value_name = "OUT.bvh")]
    output: PathBuf,
    #[command(flatten)]
    stated: StatedArgs,
    /// The table that a repair of the take wrote with --fills: what was filled counts the less the less sure it is
    #[arg(long, value_name = "FILE.csv")]
    fills: Option<PathBuf>,
    /// Order of the rotation channels in the BVH file
    #[arg(long, default_value = "zyx", value_parser = order(), ignore_case = true)]
    order: Order,
    /// The table of frames, with how far every marker is from its place [default: the output's name with .frames.csv]
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// The log for Foxglove or Lichtblick [default: the output's name with .mcap]
    #[arg(long, value_name = "FILE.mcap", conflicts_with = "no_log")]
    log: Option<PathBuf>,
    /// Write no log
    #[arg(long)]
    no_log: bool,
    /// Show at most so many frames per second in the log's markers, body and skeleton
    #[arg(long, value_name = "HZ", value_parser = positive, conflicts_with = "no_log")]
    log_rate: Option<f64>,
    /// Write a report to look at: one HTML file with player and curves, for any browser
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Replace files that exist
    #[arg(long)]
    force: bool,
    /// Read the body and the take, check all names and tell what would be done; solve and write nothing
    #[arg(long)]
    dry_run: bool,
    /// Report as JSON lines on standard output
    #[arg(long)]
    pub json: bool,
    /// Print nothing unless it failed
    #[arg(short, long)]
    pub quiet: bool,
}

impl SolveArgs {
    pub fn request(&self) -> Request {
        let wearer = self.wearer.files(self.calibrate);
        let named = |extension: &str| compression::inner_name(&self.output).with_extension(extension);
        Request {
            input: self.input.clone(),
            reading: self.stated.reading(),
            wearer,
            fills: self.fills.clone(),
            settings: Settings::default(),
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
