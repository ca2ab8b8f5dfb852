"""What a person at a terminal sees: progress that fits, colours where they are wanted, and nothing left behind.

    python3 tests/python/check_terminal.py target/release/mocap-repair FOLDER

Runs the program in a pseudo-terminal; FOLDER is made, with a take to repair. Also lets groff set the manual pages, if it is there.
The last line says how many checks passed and failed. Where there are no pseudo-terminals, it says that it ignores them.
"""

import os
import re
import select
import shutil
import subprocess
import sys

try:
    import fcntl
    import pty
    import struct
    import termios
except ImportError:
    print("ignored: there are no pseudo-terminals here")
    sys.exit(0)

COLOUR = re.compile(r"\x1b\[[0-9;]*m")
ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
passed = failed = 0


def check(name, holds, told=""):
    global passed, failed
    if holds:
        passed += 1
    else:
        failed += 1
        print(f"failed: {name}\n{told!r}")


def at_terminal(columns, words, folder, **environment):
    """All that the program writes to a terminal of so many columns."""
    speaking = ("NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE", "CI", "LC_ALL", "COLUMNS")
    base = {name: value for name, value in os.environ.items() if name not in speaking}
    base.update({"TERM": "xterm-256color", "LC_ALL": "C.UTF-8"}, **environment)
    leader, follower = pty.openpty()
    fcntl.ioctl(follower, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    child = subprocess.Popen(words, cwd=folder, stdin=subprocess.DEVNULL, stdout=follower, stderr=follower, env=base, close_fds=True)
    os.close(follower)
    written = b""
    while True:
        ready, _, _ = select.select([leader], [], [], 300)
        try:
            piece = os.read(leader, 65536) if ready else b""
        except OSError:
            piece = b""
        if not piece:
            break
        written += piece
    os.close(leader)
    return child.wait(), written.decode("utf-8")


def widest(text):
    """The widest line that was ever drawn; whatever moves the cursor begins another one."""
    drawn = ESCAPE.sub("\n", COLOUR.sub("", text))
    return max((line.rstrip() for line in re.split(r"[\r\n]", drawn)), key=len)


def fits(text, columns):
    """Every drawn line is at most so wide. Progress fills its lines with blanks to the edge and goes on in the next one."""
    drawn = re.split(r"[\r\n]", ESCAPE.sub("\n", COLOUR.sub("", text)))
    return all(len(line.rstrip()) <= columns or line[columns - 1] == " " for line in drawn)


def batches(program, folder):
    """A line for each worker and one for all; what did not go well stays."""
    takes = os.path.join(folder, "takes")
    os.makedirs(takes)
    for name in ("one", "another with a very long name, as studios give them to takes of the third day of shooting", "läufe"):
        shutil.copy(os.path.join(folder, "walk-gaps.c3d"), os.path.join(takes, f"{name}.c3d"))
    with open(os.path.join(takes, "bad\x1b[2J.c3d"), "w", encoding="ascii") as bad:
        bad.write("no take")
    subprocess.run([program, "batch", "plan", "takes", "-o", "plan.jsonl"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    for at, columns in enumerate((100, 40)):
        code, told = at_terminal(columns, [program, "batch", "run", "plan.jsonl", "--out", f"batch-{at}", "--jobs", "2"], folder)
        check(f"batch in {columns} columns: accounted for", code == 3, told)
        # what did not go well is told whole, be it longer than a line, and names of folders stay in one piece
        calm = "\n".join(line for line in re.split(r"[\r\n]", told) if "put aside:" not in line and "-> " not in line)
        check(f"batch in {columns} columns: nothing is wider", fits(calm, columns), widest(calm))
        check(f"batch in {columns} columns: workers show", re.search(r"(one|läufe|another).*  \d+ s", told), told)
        check(f"batch in {columns} columns: the whole shows", re.search(r"[0-3] of 4 takes", told), told)
        check(f"batch in {columns} columns: trouble stays, and disturbs nothing", "bad" in told and "\x1b[2J" not in told, told)
        rest = told[told.rindex("plan.jsonl"):]
        check(f"batch in {columns} columns: the summary is the last that is there", "3 repaired" in rest and " of 4 takes" not in rest, rest)


def main():
    program, folder = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    os.makedirs(folder)  # one that is there is somebody's
    # long enough to be seen, on a quick machine too: what ends within a few redraws shows nothing of its steps
    subprocess.run([program, "demo", "-o", ".", "--frames", "2400"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    repair = [program, "walk-gaps.c3d", "-o", "out.c3d", "--force"]

    for columns in (80, 40):
        code, told = at_terminal(columns, repair, folder)
        check(f"{columns} columns: repaired", code == 0, told)
        check(f"{columns} columns: the stage shows", "auto" in told and re.search(r"[123]/3", told), told)
        check(f"{columns} columns: the bar shows", "█" in told, told)
        check(f"{columns} columns: nothing is wider", fits(told, columns), widest(told))
        check(f"{columns} columns: colours", COLOUR.search(told), told)
        rest = told[told.rindex("walk-gaps.c3d"):]
        check(f"{columns} columns: the summary is the last that is there", "expected" in rest and "█" not in rest, rest)

    _, told = at_terminal(80, repair + ["--method", "bolero-sc", "--hidden", "32", "--tolerance", "1e-15"], folder)
    check("EM tells its likelihood", "log-likelihood" in told, told)
    _, told = at_terminal(80, repair, folder, NO_COLOR="1")
    check("NO_COLOR: progress without colours", "█" in told and not COLOUR.search(told), told)
    for integration in ({}, {"CI": "true"}):  # libraries take CI for a wish for colours
        for words in (repair, [program, "--help"], [program, "missing.c3d"]):
            _, told = at_terminal(80, words, folder, TERM="dumb", **integration)
            check(f"TERM=dumb {integration}: no escapes at all in {words[1:]}", "\x1b" not in told and len(told) > 50, told)
    _, told = at_terminal(80, repair, folder, TERM="dumb", CLICOLOR_FORCE="1")
    check("CLICOLOR_FORCE: colours even so", COLOUR.search(told), told)
    _, told = at_terminal(80, repair, folder, LC_ALL="C")
    check("a locale without UTF-8: ASCII only", told.isascii() and "###" in told, told)
    for silent in ("--json", "--quiet"):
        code, told = at_terminal(80, repair + [silent], folder)
        check(f"{silent}: no progress, no colours", code == 0 and "\x1b" not in told, told)
        check(f"{silent}: data only", all(line.startswith("{") for line in told.split("\r\n") if line), told)

    for columns in (80, 40, 120):
        _, told = at_terminal(columns, [program, "inspect", "walk-gaps.c3d"], folder)
        check(f"inspect in {columns} columns fits", columns >= len(widest(told)) > columns - 20, widest(told))
    _, told = at_terminal(80, [program, "inspect", "walk-gaps.c3d", "--json"], folder)
    check("inspect --json is plain", "\x1b" not in told and told.startswith("{"), told)

    batches(program, folder)
    pages = subprocess.run([program, "man", "-o", "man"], cwd=folder, check=True, capture_output=True, text=True).stdout.split()
    check("there are pages", len(pages) > 5, pages)
    if shutil.which("groff"):
        for page in pages:
            groff = subprocess.run(["groff", "-man", "-ww", "-Tutf8", page], cwd=folder, capture_output=True, text=True)
            check(f"{page} is set without warnings", groff.returncode == 0 and not groff.stderr, groff.stderr)
    else:
        print("the manual pages are not looked at: groff is not here")

    print(f"{passed} passed, {failed} failed")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
