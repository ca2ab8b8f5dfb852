#![allow(clippy::unwrap_used)]

use super::super::Cli;
use super::*;
use clap::CommandFactory;
use std::collections::BTreeSet;

/// A value for each option, other than its default. A new option needs one here.
const SAMPLES: &[(&str, &[&str])] = &[
    ("method", &["bolero-sc"]),
    ("hidden", &["24"]),
    ("energy", &["0.95"]),
    ("lambda", &["1e-3"]),
    ("iterations", &["7"]),
    ("tolerance", &["1e-12"]),
    ("impute", &[]),
    ("start", &["zero"]),
    ("init", &["random"]),
    ("noise", &["isotropic"]),
    ("step", &["gradient"]),
    ("as-printed", &[]),
    ("seed", &["18446744073709551615"]),
    ("max-gap", &["120"]),
    ("extrapolate", &[]),
    ("markers", &["LKNE", "R\"?*'\\"]),
    ("max-sigma", &["20"]),
    ("bones", &["hard", "a folder/bönes.csv"]),
    ("explain", &[]),
    ("rate", &["59.94"]),
    ("units", &["m"]),
    ("missing", &["LKNE:120-180", "table.csv"]),
    ("float", &[]),
    ("fills", &["fills.csv"]),
    ("log", &["-dash.mcap"]),
    ("no-log", &[]),
    ("timings", &[]),
    ("log-rate", &["30"]),
    ("log-source", &[]),
    ("report", &["report.html"]),
    ("drop-outliers", &[]),
    ("ignore-outliers", &[]),
    ("skl", &["body.skl"]),
    ("off", &["body.off"]),
    ("vj", &["body.vj"]),
    ("cst", &["body.cst"]),
    ("unit", &["mm"]),
    ("cst-unit", &["rad"]),
    ("cst-ball", &["swing-twist"]),
    ("spine", &[]),
    ("map", &["map.csv"]),
    ("force", &[]),
    ("dry-run", &[]),
    ("json", &[]),
    ("quiet", &[]),
];

fn command() -> Command {
    let mut command = Cli::command();
    command.build();
    command
}

fn words(more: &[String]) -> Vec<OsString> {
    ["mocap-repair", "in.c3d", "-o", "out.c3d"].into_iter().map(OsString::from).chain(more.iter().map(OsString::from)).collect()
}

#[track_caller]
fn matches(words: &[OsString]) -> ArgMatches {
    Cli::command().try_get_matches_from(words).unwrap_or_else(|e| panic!("{words:?}: {e}"))
}

/// What comes of a file and what was typed beside it.
fn with(text: &str, typed: &[&str]) -> Result<ArgMatches, String> {
    let words = words(&[&["--config", "lab.toml"], typed].concat().iter().map(|&word| word.to_owned()).collect::<Vec<_>>());
    let merged = merged(&command(), &words, &matches(&words), Path::new("lab.toml"), text)?;
    Ok(matches(&merged))
}

fn typed_as(key: &str, values: &[&str]) -> Vec<String> {
    if values.is_empty() { vec![format!("--{key}")] } else { values.iter().map(|value| format!("--{key}={value}")).collect() }
}

#[test]
fn every_option_survives_the_way_there_and_back() {
    let command = command();
    let known: Vec<&str> = options(&command).map(|(key, _)| key).collect();
    let sampled: Vec<&str> = SAMPLES.iter().map(|(key, _)| *key).collect();
    let without: Vec<_> = known.iter().filter(|key| !sampled.contains(key)).collect();
    assert!(without.is_empty(), "{without:?} need values in SAMPLES");
    assert!(sampled.iter().all(|key| known.contains(key)) && sampled.len() == known.len(), "{known:?}\n{sampled:?}");

    let default = matches(&words(&[]));
    for (key, values) in SAMPLES {
        let typed = matches(&words(&typed_as(key, values)));
        let (text, short) = (commented(&command, &typed), effective(&command, &typed));
        assert!(text != commented(&command, &default), "--{key}: {values:?} must not be the default");
        assert_eq!(short == effective(&command, &default), TELLING.contains(key), "--{key}");
        let back = with(&text, &[]).unwrap_or_else(|e| panic!("{e}\n{text}"));
        assert_eq!(commented(&command, &back), text);
        assert_eq!(effective(&command, &back), short);
        // what is left out is not said, so the short text does as well
        let shorter = with(&short, &[]).unwrap_or_else(|e| panic!("{e}\n{short}"));
        assert_eq!(effective(&command, &shorter), short);
    }
}

#[test]
fn the_effective_configuration_is_stable_and_says_nothing_of_names() {
    let command = command();
    let of = |more: &[&str]| effective(&command, &matches(&words(&more.iter().map(|&word| word.to_owned()).collect::<Vec<_>>())));
    assert_eq!(of(&["--max-gap", "12", "--rate=1e2"]), of(&["--rate", "100.0", "--max-gap=12"]));
    assert_eq!(of(&["--json", "--fills", "f.csv", "--log=l.mcap", "-q", "--force"]), of(&[]));
    assert!(of(&["--rate=1e2"]).contains("\nrate = 100.0\n"), "{}", of(&["--rate=1e2"]));
    assert!(!of(&["--energy", "0.9"]).contains("hidden"), "a default that energy takes the place of does not hold");
    let names: BTreeSet<&str> = command.get_arguments().filter_map(Arg::get_long).collect();
    assert!(TYPED.iter().chain(&TELLING).all(|name| names.contains(name)), "{names:?}");
}

#[test]
fn what_is_typed_overrules_the_file() {
    let file = "max-gap = 120\nmarkers = [\"A\", \"B\"]\nenergy = 0.9\nno-log = true\nextrapolate = true\n";
    let number = |matches: &ArgMatches, key: &str| matches.get_one::<usize>(key).copied();
    let plain = with(file, &[]).unwrap();
    assert_eq!((number(&plain, "max_gap"), plain.get_flag("extrapolate")), (Some(120), true));
    assert_eq!(plain.get_many::<String>("markers").unwrap().collect::<Vec<_>>(), ["A", "B"]);
    let typed = with(file, &["--max-gap", "7", "--markers", "C", "--hidden", "8", "--log", "l.mcap"]).unwrap();
    assert_eq!(number(&typed, "max_gap"), Some(7));
    assert_eq!(typed.get_many::<String>("markers").unwrap().collect::<Vec<_>>(), ["C"]);
    assert_eq!((typed.get_one::<f64>("energy"), typed.get_one::<u32>("hidden"), typed.get_flag("no_log")), (None, Some(&8), false));
    let unset = with(file, &["--unset", "extrapolate,max-gap", "--unset", "no-log"]).unwrap();
    assert_eq!((number(&unset, "max_gap"), unset.get_flag("extrapolate"), unset.get_flag("no_log")), (None, false, false));
    assert!(unset.get_one::<f64>("energy").is_some());
}

#[test]
fn files_are_looked_for_from_the_folder_of_the_file() {
    let command = command();
    let words = words(&["--config".to_owned(), "lab/x.toml".to_owned()]);
    let text =
        "bones = [\"hard\", \"b.csv\"]\nmissing = [\"LKNE:1-2\", \"m.csv\"]\nfills = \"f.csv\"\nlog = \"/log.mcap\"\nmarkers = \"a.csv\"\n";
    let merged = merged(&command, &words, &matches(&words), Path::new("lab/x.toml"), text).unwrap();
    let inside: Vec<_> = merged[1..=merged.len() - words.len()].iter().map(|word| word.to_str().unwrap()).collect();
    let slash = |word: &str| word.replace('/', std::path::MAIN_SEPARATOR_STR);
    let bones = format!("--bones={}b.csv", slash("lab/"));
    assert_eq!(inside[0], "--bones=hard");
    assert_eq!(inside[1], bones);
    assert_eq!(inside[2..4], ["--missing=LKNE:1-2".to_owned(), format!("--missing={}m.csv", slash("lab/"))]);
    assert_eq!(inside[4..], [format!("--fills={}f.csv", slash("lab/")), "--log=/log.mcap".to_owned(), "--markers=a.csv".to_owned()]);
}

#[test]
fn errors_name_file_line_and_key() {
    for (text, told) in [
        ("\nmax_gap = 3\n", "line 2: there is no option \"max_gap\"; did you mean max-gap?"),
        ("extrapolat = true\n", "line 1: there is no option \"extrapolat\"; did you mean extrapolate?"),
        ("xyzzy = true\n", "line 1: there is no option \"xyzzy\"; --print-config shows all there are"),
        ("output = \"o.c3d\"\n", "line 1: output is said on the command line, for each take, not in a configuration"),
        ("# a\n# b\nmax-gap = \"3\"\n", "line 3: max-gap = \"3\": expected a whole number"),
        ("max-gap = 3.5\n", "line 1: max-gap = 3.5: expected a whole number"),
        ("max-gap = -3\n", "line 1: max-gap = -3: expected a whole number that is not negative"),
        ("rate = true\n", "line 1: rate = true: expected a number"),
        ("rate = 0\n", "line 1: rate = 0: expected a number of frames per second, from 0.001 to 1000000"),
        ("hidden = 300\n", "line 1: hidden = 300: 300 is not in 1..=256"),
        ("extrapolate = 1\n", "line 1: extrapolate = 1: expected true or false"),
        ("init = \"randm\"\n", "line 1: init = \"randm\": expected one of: pca, random; did you mean random?"),
        (
            "method = \"bolero\"\n",
            "line 1: method = \"bolero\": expected one of: linear, spline, msvd, lds, bolero-hc, bolero-sc, skeleton, auto; did you mean",
        ),
        ("fills = [\"a\"]\n", "line 1: fills = [\"a\"]: expected text in quotes"),
        ("markers = [1]\n", "line 1: markers = [1]: expected an array of text in quotes"),
        ("[repair]\nmax-gap = 3\n", "line 1: there is no option \"repair\""),
        ("max-gap = 3\nmax-gap = 4\n", "line 2: not TOML: duplicate key"),
        ("max-gap = \n", "line 1: not TOML: "),
        ("energy = 0.9\n\nhidden = 4\n", "line 3: hidden cannot be said together with energy (line 1)"),
        ("no-log = true\nlog = \"l.mcap\"\n", "line 2: log cannot be said together with no-log (line 1)"),
    ] {
        let error = with(text, &[]).unwrap_err();
        assert!(error.starts_with(&format!("lab.toml: {told}")), "{error}\nexpected: {told}");
    }
    assert!(with("no-log = false\nlog = \"l.mcap\"\nmarkers = []\n", &[]).is_ok());
}
