//! Completions and manual pages.

use crate::lab::Lab;

#[test]
fn every_shell_has_a_script() {
    let lab = Lab::empty();
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let script = lab.run(&["completions", shell]).with_code(0).out;
        assert!(script.contains("mocap-repair") && script.contains("max-gap") && script.contains("inspect"), "{shell}");
    }
    assert_eq!(lab.run(&["completions", "tcsh"]).code, 2);
}

/// What a bash offers after the words of a line, the last of which is being typed.
#[cfg(unix)]
fn offered(lab: &Lab, words: &[&str]) -> Vec<String> {
    let program = "source ./script
        COMP_WORDS=(\"$@\"); COMP_CWORD=$(($# - 1))
        function=$(complete -p mocap-repair | sed 's/.*-F \\([^ ]*\\) .*/\\1/')
        $function mocap-repair \"${COMP_WORDS[COMP_CWORD]}\" \"${COMP_WORDS[COMP_CWORD - 1]}\"
        printf '%s\\n' \"${COMPREPLY[@]}\"";
    let mut bash = std::process::Command::new("bash");
    bash.args(["-c", program, "bash", "mocap-repair"]).args(words).current_dir(lab.folder());
    let output = bash.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut offered: Vec<String> = String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect();
    offered.sort();
    offered
}

#[cfg(unix)]
#[test]
fn a_bash_completes() {
    let lab = Lab::empty();
    lab.write("script", lab.run(&["completions", "bash"]).with_code(0).out);
    lab.write("walk.c3d", "");
    for (words, expected) in [
        (&["--max-"][..], &["--max-gap", "--max-sigma"][..]),
        (&["ins"], &["inspect"]),
        (&["inspect", "--a"], &["--all", "--ascii"]),
        (&["convert", "--fr"], &["--from-units", "--from-up"]),
        (&["--method", "bol"], &["bolero-hc", "bolero-sc"]),
        (&["--init", ""], &["pca", "random"]),
        (&["completions", "z"], &["zsh"]),
        (&["--output", "wa"], &["walk.c3d"]),
        (&["batch", "wa"], &["watch"]),
        (&["batch", "run", "--sh"], &["--shard"]),
    ] {
        assert_eq!(offered(&lab, words), expected, "{words:?}");
    }
}

#[test]
fn manual_pages_are_written_whole_or_not_at_all() {
    let lab = Lab::empty();
    let main = lab.run(&["man"]).with_code(0).out;
    assert!(main.contains("EXIT STATUS") && main.contains("EXAMPLES") && main.contains("mocap\\-repair\\-inspect(1)"), "{main}");
    let names = lab.run(&["man", "-o", "pages/man1"]).with_code(0).out;
    let names: Vec<&str> = names.lines().collect();
    assert_eq!(names.len(), std::fs::read_dir(lab.path("pages/man1")).unwrap().count());
    assert!(names.contains(&"pages/man1/mocap-repair-convert.1"), "{names:?}");
    assert!(names.contains(&"pages/man1/mocap-repair-batch-run.1") && !names.iter().any(|name| name.contains("take")), "{names:?}");
    assert_eq!(lab.text("pages/man1/mocap-repair.1"), main);
    let again = lab.run(&["man", "-o", "pages/man1"]);
    assert!(again.code == 1 && again.err.contains("exists already") && again.err.contains("--force"), "{again:?}");
    lab.run(&["man", "-o", "pages/man1", "--force"]).with_code(0);
}
