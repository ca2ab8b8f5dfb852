//! What can be typed for one take: options, their values, and what they mean.

use super::rig::WearerArgs;
use crate::compression;
use crate::convert::Conversion;
use crate::gaps::Policy;
use crate::input::Reading;
use crate::missing;
use crate::repair::Request;
use crate::rig::wearer::WearerFiles;
use crate::solve::auto::{Recipe, Stiffness};
use crate::solve::lds::em::Noise;
use crate::solve::lds::step::BoneStep;
use crate::solve::lds::{EStep, Hidden, Init, Start};
use crate::solve::{Limits, Method, Settings};
use crate::suspects::Treatment;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Arg, Args, ValueEnum, ValueHint};
use formats::{Direction, Format, Stated, Unit};
use std::any::TypeId;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// What the user knows better than the file.
#[derive(Debug, Args)]
pub(super) struct StatedArgs {
    /// Frame rate, if the file does not say it or says it wrong
    #[arg(long, value_name = "HZ", value_parser = rate, allow_negative_numbers = true)]
    rate: Option<f64>,
    /// Unit of length, if the file does not say it or says it wrong
    #[arg(long, value_enum)]
    units: Option<UnitArg>,
    #[command(flatten)]
    missing: MissingArgs,
}

#[derive(Debug, Args)]
pub(super) struct MissingArgs {
    /// Samples that are missing although the file holds something in their place: a marker (* and ? allowed) and frames by the file's own
    /// numbers, or a CSV with the columns marker and frame, or marker, first_frame and last_frame; may be said more than once
    #[arg(long, value_name = "MARKER[:FIRST-LAST]|FILE.csv", value_hint = ValueHint::AnyPath)]
    missing: Vec<String>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum UnitArg {
    Mm,
    Cm,
    M,
}

impl From<UnitArg> for Unit {
    fn from(unit: UnitArg) -> Self {
        match unit {
            UnitArg::Mm => Self::Millimetre,
            UnitArg::Cm => Self::Centimetre,
            UnitArg::M => Self::Metre,
        }
    }
}

impl StatedArgs {
    pub fn reading(&self) -> Reading {
        let stated = Stated { rate_hz: self.rate, unit: self.units.map(Unit::from), ..Stated::default() };
        Reading { stated, missing: self.missing.missing.clone(), ..Reading::default() }
    }
}

/// `mocap-repair layout`.
#[derive(Debug, Args)]
pub(super) struct LayoutArgs {
    /// The log of a repair
    #[arg(value_name = "LOG.mcap")]
    pub log: PathBuf,
    /// The file to write; import it in the viewer
    #[arg(short, long, value_name = "FILE.json")]
    pub output: PathBuf,
    /// Replace a file that exists
    #[arg(long)]
    pub force: bool,
}

/// `mocap-repair report`.
#[derive(Debug, Args)]
pub(super) struct ReportArgs {
    /// The log of a repair
    #[arg(value_name = "LOG.mcap")]
    pub log: PathBuf,
    /// The file to write; open it in a browser
    #[arg(short, long, value_name = "FILE.html")]
    pub output: PathBuf,
    /// Replace a file that exists
    #[arg(long)]
    pub force: bool,
}

/// `mocap-repair convert`.
#[derive(Args)]
#[allow(clippy::struct_excessive_bools)] // each is a switch that somebody types
pub(super) struct ConvertArgs {
    /// The take to convert; it is never written
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The file to write; its extension names the format, and .zst behind that compresses it
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,
    /// The format to write, where the extension does not say it
    #[arg(long, value_name = "FORMAT", value_parser = format(), ignore_case = true)]
    to: Option<&'static dyn Format>,
    /// Unit of length to write [default: the input's]
    #[arg(long, value_enum)]
    units: Option<UnitArg>,
    /// The axis that is to point up, such as z, y or -y: the take is turned as a whole
    #[arg(long, value_name = "AXIS", value_parser = direction, allow_hyphen_values = true)]
    up: Option<Direction>,
    /// Unit of length of the input, if the file does not say it or says it wrong
    #[arg(long, value_enum, value_name = "UNITS")]
    from_units: Option<UnitArg>,
    /// The axis that points up in the input, if the file does not say it or says it wrong
    #[arg(long, value_name = "AXIS", value_parser = direction, allow_hyphen_values = true)]
    from_up: Option<Direction>,
    /// Frame rate of the input, if the file does not say it or says it wrong; no frames are added or left out
    #[arg(long, value_name = "HZ", value_parser = rate, allow_negative_numbers = true)]
    rate: Option<f64>,
    #[command(flatten)]
    missing: MissingArgs,
    /// Take a C3D of integers for one of floating-point numbers
    #[arg(long)]
    float: bool,
    /// Replace a file that exists
    #[arg(long)]
    force: bool,
    /// Report as JSON lines on standard output
    #[arg(long)]
    pub json: bool,
    /// Print nothing unless it failed
    #[arg(short, long)]
    pub quiet: bool,
}

impl ConvertArgs {
    pub fn conversion(&self) -> Conversion {
        let stated = Stated { rate_hz: self.rate, unit: self.from_units.map(Unit::from), ..Stated::default() };
        Conversion {
            input: self.input.clone(),
            output: self.output.clone(),
            reading: Reading { stated, missing: self.missing.missing.clone(), float: self.float, ..Reading::default() },
            from_up: self.from_up,
            to: self.to,
            unit: self.units.map(Unit::from),
            up: self.up,
            force: self.force,
        }
    }
}

impl std::fmt::Debug for ConvertArgs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ConvertArgs").field("input", &self.input).field("output", &self.output).finish_non_exhaustive()
    }
}

fn direction(text: &str) -> Result<Direction, String> {
    Direction::parse(text).ok_or_else(|| "expected x, y or z, with - before it for the opposite direction".to_owned())
}

fn format() -> impl TypedValueParser<Value = &'static dyn Format> {
    let known = |name: &str| formats::ALL.iter().find(|format| format.info().name.eq_ignore_ascii_case(name)).copied();
    PossibleValuesParser::new(formats::ALL.iter().map(|format| format.info().name))
        .try_map(move |name| known(&name).ok_or("no format of this name"))
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum StartArg {
    Model,
    Interpolate,
    Zero,
}

/// What `demo` makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum DemoKind {
    /// A take of 41 markers: its truth, and the same with gaps, as C3D and CSV
    Take,
    /// Skeleton, surface and limits of a body, a cloud of points for each frame, labelled markers, and the true joints
    Body,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum InitArg {
    Pca,
    Random,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum NoiseArg {
    Isotropic,
    Diagonal,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum StepArg {
    GaussNewton,
    Gradient,
}

/// What `--bones` can be given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum BonesArg {
    Stiffness(Stiffness),
    File(PathBuf),
}

impl From<OsString> for BonesArg {
    fn from(text: OsString) -> Self {
        match text.to_str() {
            Some("soft") => Self::Stiffness(Stiffness::Soft),
            Some("hard") => Self::Stiffness(Stiffness::Hard),
            _ => Self::File(text.into()),
        }
    }
}

#[derive(Debug, Args)]
#[command(
    mut_arg("skl", |arg| with_skeleton(arg)),
    mut_arg("off", |arg| with_skeleton(arg)),
    mut_arg("vj", |arg| with_skeleton(arg)),
    mut_arg("map", |arg| with_skeleton(arg))
)]
#[allow(clippy::struct_excessive_bools)] // each is a switch that somebody types
pub(super) struct RepairArgs {
    /// The take to repair; it is never written
    #[arg(value_name = "IN", required_unless_present = "print_config", num_args = 1..)]
    pub inputs: Vec<PathBuf>,
    /// The repaired take; its extension may name another format
    #[arg(short, long, value_name = "OUT", required_unless_present_any = ["in_place", "dry_run", "print_config"])]
    pub output: Option<PathBuf>,
    /// How to fill
    #[arg(long, value_name = "METHOD", default_value = Method::default().name(), value_parser = method())]
    pub method: Method,
    /// Dimension of the hidden state; rank of msvd
    #[arg(long, value_name = "H", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=256))]
    pub hidden: u32,
    /// As many hidden dimensions as hold this share of the motion's energy, for instance 0.95
    #[arg(long, value_name = "SHARE", conflicts_with = "hidden", value_parser = share)]
    pub energy: Option<f64>,
    /// Weight of all bones as in the paper, 1/m^4 [default: each bone by its own spread]
    #[arg(long, value_name = "L", value_parser = positive)]
    pub lambda: Option<f64>,
    /// The most EM iterations
    #[arg(long, value_name = "N", default_value_t = Limits::default().steps, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub iterations: u32,
    /// Stop when the log-likelihood changes by less than this share of itself
    #[arg(long, value_name = "E", default_value_t = Limits::default().tolerance, value_parser = positive)]
    pub tolerance: f64,
    /// The paper's E-step, which takes the present fill for measured
    #[arg(long)]
    pub impute: bool,
    /// Where EM begins to fill: where its first model expects the markers, on straight lines, or at each marker's mean
    /// [default: model, or interpolate with --init random]
    #[arg(long, value_enum)]
    pub start: Option<StartArg>,
    /// The first parameters of EM: from principal components, or drawn at random
    #[arg(long, value_enum, default_value_t = InitArg::Pca)]
    pub init: InitArg,
    /// Noise of the model: one variance for everything, or one for each marker and a full matrix for the states
    #[arg(long, value_enum, default_value_t = NoiseArg::Diagonal)]
    pub noise: NoiseArg,
    /// How soft bones are met: Gauss-Newton steps, or the paper's gradient descent, which takes each frame alone
    #[arg(long, value_enum, default_value_t = StepArg::GaussNewton)]
    pub step: StepArg,
    /// Let bones act as the paper prints it: each frame alone, on the fill only, nothing joined at the edges of gaps
    #[arg(long)]
    pub as_printed: bool,
    /// Seed for methods that draw random numbers
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Leave gaps longer than this open, whole
    #[arg(long, value_name = "FRAMES")]
    pub max_gap: Option<usize>,
    /// Fill gaps that reach the take's first or last frame, too
    #[arg(long)]
    pub extrapolate: bool,
    /// Fill these markers only (labels with or without prefix; * and ? allowed); all others still help
    #[arg(long, value_name = "PATTERN", value_delimiter = ',')]
    pub markers: Vec<String>,
    /// Leave gaps open, whole, of which a sample is predicted to be off by more than this
    #[arg(long, value_name = "MM", value_parser = positive)]
    pub max_sigma: Option<f64>,
    /// Bones to keep (CSV: marker,marker[,length in mm]) instead of those found, or how auto keeps them: soft, by the spread that each
    /// shows, or hard, exactly; may be said twice
    #[arg(long, value_name = "FILE|soft|hard", value_hint = ValueHint::AnyPath)]
    pub bones: Vec<BonesArg>,
    /// Say for each gap which neighbours and experts filled it, and how far it may be off
    #[arg(long)]
    pub explain: bool,
    /// Make gaps of samples that no body makes (spikes, swapped markers, ghosts beside gaps), and fill those like others
    #[arg(long, conflicts_with = "ignore_outliers")]
    pub drop_outliers: bool,
    /// Leave samples that no body makes as they are, but fill nothing from them
    #[arg(long)]
    pub ignore_outliers: bool,
    #[command(flatten)]
    pub stated: StatedArgs,
    /// Make a C3D of integers one of floating-point numbers, so that every filled value fits
    #[arg(long)]
    float: bool,
    /// Write one row per filled sample
    #[arg(long, value_name = "FILE.csv")]
    pub fills: Option<PathBuf>,
    /// Write a report to look at: one HTML file with player, gap map and curves, for any browser
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Write the log here [default: the output's name with .mcap]
    #[arg(long, value_name = "FILE.mcap", conflicts_with = "no_log")]
    pub log: Option<PathBuf>,
    /// Write no log
    #[arg(long)]
    pub no_log: bool,
    /// Write computing times into the log (then it differs from run to run)
    #[arg(long)]
    pub timings: bool,
    /// Draw at most so many frames per second in the log; tables and curves keep all of them [default: every frame]
    #[arg(long, value_name = "HZ", value_parser = rate)]
    pub log_rate: Option<f64>,
    /// Put the input itself into the log
    #[arg(long)]
    pub log_source: bool,
    /// Replace files that exist
    #[arg(long)]
    pub force: bool,
    /// Put the repaired take under the input's name and keep the input as IN.orig
    #[arg(long, conflicts_with = "output")]
    pub in_place: bool,
    /// Read, decide and report; solve and write nothing
    #[arg(long)]
    pub dry_run: bool,
    /// Read options from a file, which has their long names as keys; what is typed overrules it
    #[arg(long, value_name = "FILE.toml")]
    pub config: Option<PathBuf>,
    /// Take no notice of what --config says about an option; may be said more than once
    #[arg(long, value_name = "KEY", requires = "config", value_delimiter = ',')]
    pub unset: Vec<String>,
    /// Print all options, as they would hold now, as a file for --config; do nothing else
    #[arg(long)]
    pub print_config: bool,
    /// Report as JSON lines on standard output
    #[arg(long)]
    pub json: bool,
    /// Print nothing unless it failed
    #[arg(short, long)]
    pub quiet: bool,
    #[command(flatten, next_help_heading = "The body, for --method skeleton")]
    wearer: WearerArgs,
}

/// What only one method needs.
fn with_skeleton(arg: Arg) -> Arg {
    arg.required(false).required_if_eq("method", Method::Skeleton.name())
}

/// True if `text`, said about an option in a file of `folder`, names a file.
pub(super) fn names_file(option: &Arg, text: &str, folder: &Path) -> bool {
    match option.get_id().as_str() {
        "bones" => matches!(BonesArg::from(OsString::from(text)), BonesArg::File(_)),
        "missing" => missing::names_table(&folder.join(text)),
        _ => option.get_value_parser().type_id() == TypeId::of::<PathBuf>(),
    }
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err("expected a number above 0".to_owned()),
    }
}

/// Frame rates from one frame in a quarter of an hour to a million a second: anything else is a slip of the finger.
pub(super) fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (1e-3..=1e6).contains(&x) => Ok(x),
        _ => Err("expected a number of frames per second, from 0.001 to 1000000".to_owned()),
    }
}

/// Named one by one, so that help and shells know them.
fn method() -> impl TypedValueParser<Value = Method> {
    PossibleValuesParser::new(Method::ALL.map(Method::name)).try_map(|name| Method::parse(&name).ok_or("no method of this name"))
}

/// A share of something, above 0 and at most 1.
pub(super) fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x <= 1.0 => Ok(x),
        _ => Err("expected a number above 0 and at most 1".to_owned()),
    }
}

impl RepairArgs {
    pub fn settings(&self) -> Settings {
        let random = self.init == InitArg::Random;
        let start = match self.start {
            Some(StartArg::Interpolate) => Start::Interpolate,
            Some(StartArg::Zero) => Start::Zero,
            // what a random model expects is nowhere near the body
            None if random => Start::Interpolate,
            Some(StartArg::Model) | None => Start::Model,
        };
        Settings {
            hidden: self.energy.map_or(Hidden::Count(self.hidden as usize), Hidden::Energy),
            lambda: self.lambda,
            e_step: if self.impute { EStep::Imputing } else { EStep::Exact },
            noise: match self.noise {
                NoiseArg::Isotropic => Noise::Isotropic,
                NoiseArg::Diagonal => Noise::Diagonal,
            },
            start,
            init: if random { Init::Random(self.seed) } else { Init::Components },
            step: match self.step {
                StepArg::Gradient => BoneStep::Gradient,
                StepArg::GaussNewton if self.as_printed => BoneStep::Frame,
                StepArg::GaussNewton => BoneStep::Coupled,
            },
            constant: !self.as_printed,
            recipe: Recipe::default(),
            stiffness: self
                .bones
                .iter()
                .rev()
                .find_map(|b| if let BonesArg::Stiffness(s) = b { Some(*s) } else { None })
                .unwrap_or_default(),
            wearer: None,
        }
    }

    /// Files that are read besides the take.
    fn reads(&self) -> Vec<PathBuf> {
        let bones = self.bones.iter().filter_map(|b| if let BonesArg::File(path) = b { Some(path.clone()) } else { None });
        let tables = self.stated.missing.missing.iter().map(PathBuf::from).filter(|path| missing::names_table(path));
        let wearer = self.wearer.has_map().then(|| self.wearer.files(false));
        let worn = wearer.iter().flat_map(WearerFiles::all).map(Path::to_owned);
        bones.chain(tables).chain(self.config.clone()).chain(worn).collect()
    }

    /// All but [`Request::config`], which only the whole command line knows.
    pub fn request(&self) -> Request {
        let mut input = self.inputs.first().cloned().unwrap_or_default();
        if self.in_place {
            // behind a link it is the file that is replaced, not the link
            if input.is_symlink() {
                input = input.canonicalize().unwrap_or(input);
            }
        }
        let output = self.output.clone().unwrap_or_else(|| input.clone());
        let log = if self.no_log || self.dry_run {
            None
        } else {
            Some(self.log.clone().unwrap_or_else(|| compression::inner_name(&output).with_extension("mcap")))
        };
        Request {
            in_place: self.in_place,
            log,
            fills: self.fills.clone(),
            page: self.report.clone(),
            bones: self.bones.iter().rev().find_map(|b| if let BonesArg::File(path) = b { Some(path.clone()) } else { None }),
            force: self.force,
            dry_run: self.dry_run,
            timings: self.timings,
            log_rate_hz: self.log_rate,
            log_source: self.log_source,
            method: self.method,
            settings: self.settings(),
            iterations: self.iterations,
            tolerance: self.tolerance,
            seed: self.seed,
            policy: Policy { max_gap: self.max_gap, extrapolate: self.extrapolate, max_sigma_mm: self.max_sigma },
            wearer: self.wearer.has_map().then(|| self.wearer.files(false)),
            markers: self.markers.clone(),
            reading: Reading { float: self.float, ..self.stated.reading() },
            config: String::new(),
            reads: self.reads(),
            outliers: match (self.drop_outliers, self.ignore_outliers) {
                (true, _) => Treatment::Dropped,
                (false, true) => Treatment::Ignored,
                (false, false) => Treatment::Told,
            },
            input,
            output,
        }
    }
}
