//! Options from a file: that they do what typed ones do, and what is said if they cannot.

use crate::lab::Lab;

#[test]
fn a_file_does_what_one_would_have_typed() {
    let lab = Lab::new();
    lab.write("lab.toml", "method = \"spline\"\nmax-gap = 15 # frames\nmarkers = [\"L*\", \"RKNE\"]\nno-log = true\n");
    let typed = ["walk-gaps.c3d", "--method", "spline", "--max-gap", "15", "--markers", "L*,RKNE", "--no-log"];
    lab.run(&[&typed[..], &["-o", "typed.c3d"]].concat()).with_code(3);
    let before = lab.listing();
    let config = ["walk-gaps.c3d", "--config", "lab.toml"];
    lab.run(&[&config[..], &["-o", "config.c3d"]].concat()).with_code(3);
    assert_eq!(lab.new_since(&before), ["config.c3d"]);
    assert!(lab.read("config.c3d") == lab.read("typed.c3d") && lab.read("typed.c3d") != lab.read("walk-gaps.c3d"));
    // for one run it can be otherwise
    let ran = lab.run(&[&config[..], &["-o", "all.c3d", "--unset", "max-gap,markers", "--unset", "no-log"]].concat()).with_code(0);
    assert!(ran.out.contains("\n  log        all.mcap\n"), "{}", ran.out);
}

#[test]
fn what_is_printed_can_be_read() {
    let lab = Lab::new();
    let options = ["--rate", "59.94", "--bones", "hard", "--extrapolate", "--missing", "LKNE:5", "--missing", "RTOE"];
    let printed = lab.run(&[&options[..], &["--print-config"]].concat()).with_code(0).out;
    lab.write("lab.toml", &printed);
    let again = lab.run(&["--config", "lab.toml", "--print-config"]).with_code(0).out;
    assert_eq!(again, printed);
    assert!(printed.contains("\nmissing = [\"LKNE:5\", \"RTOE\"]\n") && printed.contains("\nextrapolate = true\n"), "{printed}");
    assert!(printed.lines().all(|line| line.chars().count() <= 80), "{printed}");
    // it names no take, so one may be there or not
    assert_eq!(lab.run(&["walk-gaps.c3d", "-o", "x.c3d", "--config", "lab.toml", "--print-config"]).with_code(0).out, printed);
}

#[test]
fn files_are_looked_for_beside_the_configuration() {
    let lab = Lab::new();
    std::fs::create_dir(lab.path("lab")).unwrap();
    let bones = lab.run(&["bones", "walk-gaps.c3d"]).with_code(0).out;
    lab.write("lab/bones.csv", bones.lines().take(11).collect::<Vec<_>>().join("\n"));
    lab.write("lab/options.toml", "bones = \"bones.csv\"\n");
    let ran = lab.run(&["walk-gaps.c3d", "--dry-run", "--config", "lab/options.toml"]).with_code(0);
    assert!(ran.out.contains("10 bones stated"), "{}", ran.out);
}

#[test]
fn a_wrong_file_ends_with_2() {
    let lab = Lab::new();
    lab.write("typo.toml", "max-gap = 15\nmax_sigma = 3\n");
    lab.write("latin.toml", [b'#', 0xe4, b'\n']);
    let before = lab.listing();
    let told = "typo.toml: line 2: there is no option \"max_sigma\"; did you mean max-sigma?";
    for (file, told) in [
        ("typo.toml", told),
        ("none.toml", "none.toml: cannot be read: no such file or folder"),
        ("latin.toml", "latin.toml: is not UTF-8 text, as TOML has to be"),
    ] {
        let ran = lab.run(&["walk-gaps.c3d", "-o", "x.c3d", "--config", file]);
        assert_eq!((ran.code, ran.out.as_str(), ran.err), (2, "", format!("mocap-repair: {told}\n")));
    }
    let ran = lab.run(&["walk-gaps.c3d", "-o", "x.c3d", "--config", "typo.toml", "--json"]).with_code(2);
    assert_eq!(ran.messages()[0]["text"], told);
    for (arguments, told) in [
        (&["--unset", "max-gap"][..], "--config <FILE.toml>"),
        (&["--config", "typo.toml", "--unset", "maxgap"], "--unset maxgap: there is no option \"maxgap\"; did you mean max-gap?"),
    ] {
        let ran = lab.run(&[&["walk-gaps.c3d", "-o", "x.c3d"], arguments].concat());
        assert_eq!((ran.code, ran.out.as_str()), (2, ""));
        assert!(ran.err.contains(told), "{}", ran.err);
    }
    assert!(lab.new_since(&before).is_empty());
}
