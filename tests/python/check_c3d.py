#!/usr/bin/env python3
"""Reads real C3D files with this project and with two other readers, and holds them against each other.

    check_c3d.py DUMP FOLDER [--markdown]

DUMP is the example program `dump`, FOLDER has C3D files in it, at any depth.
Compares positions, missing samples, numbers of frames and points, rate, first frame and labels with those of ezc3d and of c3d (py-c3d),
and does the same with what the program makes of each file: a new one, and one of floats where it stores integers.
Where another reader is known to be wrong, DIFFERENCES says how, and why ours is right: such a file must differ in exactly that way, so that
the table cannot outlive its reasons. `--markdown` prints the table for docs/formats/differences.md instead of checking.
Prints a line per check, then `N passed, M failed`; exit code 1 if any failed. Without the folder or the readers it says so and exits with 0.
"""

import json
import pathlib
import subprocess
import sys
import tempfile
import warnings

try:
    import c3d
    import ezc3d
    import numpy as np
except ImportError as absent:
    c3d = ezc3d = np = None
    reason = str(absent)

# File (without folder), reader, what differs, and why ours is right, from the bytes.
DIFFERENCES = [
    (
        "c3dorg_sample_01_Eb015si.c3d",
        "ezc3d",
        "refused",
        "the fourth byte of the parameters is 86: floats and words are big-endian, and the same recording as Intel file (where there is one) is read alike",
    ),
    (
        "c3dorg_sample_01_Eb015sr.c3d",
        "ezc3d",
        "refused",
        "the fourth byte of the parameters is 86: floats and words are big-endian, and the same recording as Intel file (where there is one) is read alike",
    ),
    (
        "c3dorg_sample_02_sgi_int.c3d",
        "ezc3d",
        "refused",
        "the fourth byte of the parameters is 86: floats and words are big-endian, and the same recording as Intel file (where there is one) is read alike",
    ),
    (
        "c3dorg_sample_02_sgi_real.c3d",
        "ezc3d",
        "refused",
        "the fourth byte of the parameters is 86: floats and words are big-endian, and the same recording as Intel file (where there is one) is read alike",
    ),
    (
        "c3dorg_sample_06_MACsample.c3d",
        "ezc3d",
        "refused",
        "the fourth byte of the parameters is 86: floats and words are big-endian, and the same recording as Intel file (where there is one) is read alike",
    ),
    (
        "c3dorg_sample_06_MACsample.c3d",
        "py-c3d",
        "refused",
        "header and POINT:SCALE differ, 0.0551 and 0.0215; only the header's gives bodies of human size, and the difference is noted",
    ),
    (
        "btk_others_badParameterOffset.c3d",
        "ezc3d",
        "refused",
        "the step of POINT:DESCRIPTIONS (6) leaves no room for the length of its description; followed step by step, the parameters are whole",
    ),
    (
        "btk_others_badParameterOffset.c3d",
        "py-c3d",
        "refused",
        "the same",
    ),
    (
        "c3dorg_sample_13_Dance.c3d",
        "ezc3d",
        "refused",
        "ANALOG:OFFSET is of type 4 (floats, all 0) instead of 2 (words); the points do not depend on it",
    ),
    (
        "c3dorg_sample_13_golfswing.c3d",
        "ezc3d",
        "refused",
        "the same",
    ),
    (
        "c3dorg_sample_15_FP1.C3D",
        "py-c3d",
        "refused",
        "header word 3 is 120, which is 12 channels (ANALOG:USED) times 10 samples; py-c3d multiplies by 10 once more",
    ),
    (
        "c3dorg_sample_15_FP2.C3D",
        "py-c3d",
        "refused",
        "the same",
    ),
    (
        "c3dorg_sample_18_bad_parameter_section.c3d",
        "ezc3d",
        "refused",
        "the data begin in block 12, inside the last parameters, which are overwritten; POINT was read before, and damage is noted",
    ),
    (
        "c3dorg_sample_18_bad_parameter_section.c3d",
        "py-c3d",
        "refused",
        "the same",
    ),
    (
        "c3dorg_sample_27_kyowadengyo.c3d",
        "ezc3d",
        "frames",
        "the header has 11 points, POINT:USED 12; 152 frames (as claimed) of 11 points and 24 analog words end 320 bytes before the end of the file, which is padding, and a marker then moves by 41 steps from frame to frame instead of 1418",
    ),
    (
        "c3dorg_sample_27_kyowadengyo.c3d",
        "py-c3d",
        "refused",
        "the same",
    ),
    (
        "c3dorg_sample_29_Facial-Sing.c3d",
        "ezc3d",
        "refused",
        "the step of POINT:LABELS is 462, its record has 463 bytes: the length of its description is not counted; the next record is where the step leads",
    ),
    (
        "c3dorg_sample_29_Facial-Sing.c3d",
        "py-c3d",
        "refused",
        "the same",
    ),
    (
        "c3dorg_sample_30_admarche2.c3d",
        "py-c3d",
        "missing",
        "the fourth word of every sample is 1.708e38, which is no 16-bit number and no flag; the coordinates are whole and continuous",
    ),
    (
        "c3dorg_sample_30_marche281.c3d",
        "py-c3d",
        "missing",
        "the same",
    ),
    (
        "c3dorg_sample_30_emgwl.c3d",
        "ezc3d",
        "first frame",
        "word 4 of the header is 0, so the first frame is frame 0; ezc3d counts it as 1",
    ),
    (
        "kineticstoolkit__data_kinematics_sprintbasket.c3d",
        "ezc3d",
        "first frame",
        "word 4 of the header is 0, so the first frame is frame 0; ezc3d counts it as 1",
    ),
    (
        "kineticstoolkit__data_kinematics_walkingOptiTrack.c3d",
        "ezc3d",
        "first frame",
        "word 4 of the header is 0, so the first frame is frame 0; ezc3d counts it as 1",
    ),
    (
        "c3dorg_sample_33_bigparlove.c3d",
        "py-c3d",
        "refused",
        "PROCESSING:MarkerDiameter occurs 30 times; names that occur again do not matter to the points",
    ),
    (
        "c3dorg_sample_35_Mega_Electronics_Isokinetic_EMG_Angle_Torque_Sample_File.c3d",
        "py-c3d",
        "refused",
        "POINT:DATA_START is a byte instead of a word; it says 4, and so does the header",
    ),
    (
        "kineticstoolkit__data_kinematics_sample_probing_acromion_R.c3d",
        "py-c3d",
        "refused",
        "ANALOG:SCALE is a float without a dimension where py-c3d wants a list; there are no analog channels, and the points do not depend on it",
    ),
    (
        "kineticstoolkit__data_kinematics_sample_probing_radial_styloid_R.c3d",
        "py-c3d",
        "refused",
        "ANALOG:SCALE is a float without a dimension where py-c3d wants a list; there are no analog channels, and the points do not depend on it",
    ),
    (
        "kineticstoolkit__data_kinematics_sample_propulsion.c3d",
        "py-c3d",
        "refused",
        "ANALOG:SCALE is a float without a dimension where py-c3d wants a list; there are no analog channels, and the points do not depend on it",
    ),
    (
        "kineticstoolkit__data_kinematics_sample_static.c3d",
        "py-c3d",
        "refused",
        "ANALOG:SCALE is a float without a dimension where py-c3d wants a list; there are no analog channels, and the points do not depend on it",
    ),
    (
        "long_70000frames_ezc3d.c3d",
        "ezc3d",
        "frames",
        "both counts are at their 16-bit end (65535), which means \"or more\"; the data hold 70000 frames of one point and 256 bytes of padding",
    ),
    (
        "long_70000frames_ezc3d.c3d",
        "py-c3d",
        "frames",
        "the same",
    ),
]

passed, failed = 0, 0


def check(name, fine, detail=""):
    """Counts and prints one check."""
    global passed, failed
    fine = bool(fine)
    passed, failed = passed + fine, failed + (not fine)
    print(f"{'ok     ' if fine else 'FAILED '} {name}{f': {detail}' if detail and not fine else ''}", flush=True)


class Read:
    """What a reader makes of a file: positions as frames x points x 3 in the file's unit, which of them are missing, and the rest."""

    def __init__(self, positions, missing, rate, first_frame, labels):
        # Every reader has its own way to write down what is not there.
        self.missing = missing | ~np.isfinite(positions).all(axis=2) | (positions == 0).all(axis=2)
        self.positions = positions
        self.rate, self.first_frame = rate, first_frame
        self.labels = labels


def ours(dump, path):
    """By the program under test; an error message if it refuses."""
    run = subprocess.run([dump, "take", path], capture_output=True, check=False)
    if run.returncode != 0:
        return run.stderr.decode().strip()
    head, data = run.stdout.split(b"\n", 1)
    head = json.loads(head)
    shape = head["frames"], len(head["labels"])
    samples = shape[0] * shape[1]
    positions = np.frombuffer(data, "<f8", samples * 3).reshape(*shape, 3) / head["unit_mm"]
    read = Read(positions, np.zeros(shape, bool), head["rate_hz"], head["first_frame"], head["labels"])
    # A model output at 0 0 0 is a value, but other readers do not know about outputs.
    read.notes = head["notes"]
    return read


def by_ezc3d(path):
    """By ezc3d."""
    file = ezc3d.c3d(str(path))
    points = np.moveaxis(file["data"]["points"][:3], 0, 2).swapaxes(0, 1).astype(float)
    residuals = file["data"]["meta_points"]["residuals"][0].T
    missing = residuals < 0 if residuals.shape == points.shape[:2] else np.zeros(points.shape[:2], bool)
    labels = []
    for part in ["LABELS"] + [f"LABELS{i}" for i in range(2, 100)]:
        labels += file["parameters"]["POINT"].get(part, {}).get("value", []) or []
    return Read(points, missing, float(file["header"]["points"]["frame_rate"]), int(file["header"]["points"]["first_frame"]) + 1, labels)


def by_py_c3d(path):
    """By py-c3d."""
    with open(path, "rb") as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reader = c3d.Reader(file)
        frames = [points.astype(float) for _, points, _ in reader.read_frames(copy=True)]
        points = np.array(frames).reshape(len(frames), reader.point_used, 5)
        labels = []
        for part in ["LABELS"] + [f"LABELS{i}" for i in range(2, 100)]:
            parameter = reader.get(f"POINT:{part}")
            labels += list(parameter.string_array) if parameter is not None and parameter.dimensions else []
        return Read(points[..., :3], points[..., 3] < 0, float(reader.point_rate), int(reader.first_frame), [str(l) for l in labels])


READERS = {"ezc3d": by_ezc3d, "py-c3d": by_py_c3d}


def label(text):
    """A label as it can be compared: readers disagree about padding and about what is not ASCII."""
    return "".join(c for c in str(text).split("\0")[0].strip() if c.isascii())


def difference(is_, other, tolerance=2e-7):
    """What the first difference is, in one word and in figures; None if there is none."""
    if is_.positions.shape[0] != other.positions.shape[0]:
        return "frames", f"{is_.positions.shape[0]} here, {other.positions.shape[0]} there"
    if is_.positions.shape[1] != other.positions.shape[1]:
        return "points", f"{is_.positions.shape[1]} here, {other.positions.shape[1]} there"
    if not np.array_equal(is_.missing, other.missing):
        here, there = (is_.missing & ~other.missing).sum(), (other.missing & ~is_.missing).sum()
        return "missing", f"{here} samples missing only here, {there} only there"
    known = ~is_.missing
    # The product of an integer and its scale is rounded differently.
    off = np.abs(is_.positions - other.positions)[known] - tolerance * np.abs(is_.positions)[known]
    if off.size and off.max() > 1e-9:
        return "positions", f"off by up to {off.max():.3g}"
    if abs(is_.rate - other.rate) > 1e-5 * is_.rate:
        return "rate", f"{is_.rate} Hz here, {other.rate} Hz there"
    if is_.first_frame != other.first_frame:
        return "first frame", f"{is_.first_frame} here, {other.first_frame} there"
    mine, theirs = [label(l) for l in is_.labels], [label(l) for l in other.labels]
    # Labels beyond the points, and points without a label, are a matter of taste.
    count = min(len(mine), len(theirs))
    if any(a and b and a != b for a, b in zip(mine[:count], theirs[:count])):
        return "labels", next(f"{a!r} here, {b!r} there" for a, b in zip(mine, theirs) if a and b and a != b)
    return None


def look(read, path, mine):
    """How another reader differs: a word and figures, or None."""
    try:
        other = read(path)
    except Exception as error:  # readers fail in every way there is
        return "refused", f"{type(error).__name__}: {' '.join(str(error).split())[:90]}"
    return difference(mine, other)


def compare(name, mine, path):
    """Holds one file against both readers."""
    for reader, read in READERS.items():
        found = look(read, path, mine)
        expected = next((entry for entry in DIFFERENCES if entry[0] == name and entry[1] == reader), None)
        if expected is None:
            check(f"{name}: as {reader} reads it", found is None, ": ".join(found or ()))
        else:
            check(f"{name}: {reader} is wrong about {expected[2]}", found is not None and found[0] == expected[2], f"found {found}")


def compare_made(name, mine, made, what, readers=READERS):
    """Holds what the program made against the take: nobody has an excuse here."""
    for reader in readers:
        found = look(READERS[reader], made, mine)
        check(f"{name}: {what}, as {reader} reads it", found is None, ": ".join(found or ()))


def table():
    """The differences as Markdown."""
    lines = ["| file | reader | differs in | why ours is right |", "| --- | --- | --- | --- |"]
    return "\n".join(lines + [f"| {file} | {reader} | {what} | {why} |" for file, reader, what, why in DIFFERENCES])


def main():
    """Goes through all files."""
    if "--markdown" in sys.argv:
        print(table())
        return
    dump, folder = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2])
    files = sorted(p for p in folder.rglob("*") if p.suffix.lower() == ".c3d") if folder.is_dir() else []
    if np is None or not files:
        print(f"ignored: {reason if np is None else f'no C3D files in {folder}'}; NOTHING WAS COMPARED")
        return
    names = {path.name for path in files}
    for file, reader, *_ in DIFFERENCES:
        check(f"{file} is there for its difference to {reader}", file in names)
    with tempfile.TemporaryDirectory() as made:
        for path in files:
            mine = ours(dump, path)
            if isinstance(mine, str):
                # What we refuse is listed, with its reasons, in tests/shared.rs.
                print(f"        {path.name}: refused: {mine.removeprefix(str(path))}")
                continue
            compare(path.name, mine, path)
            new = pathlib.Path(made) / "new.c3d"
            if subprocess.run([dump, "create", path, new], check=False).returncode == 0:
                again = ours(dump, new)
                # A new file keeps the number of its first frame, and readers keep their opinion about number 0.
                known = [r for r in READERS if again.first_frame > 0 or r != "ezc3d"]
                # Without points there is nothing to compare, and no reader counts frames of nothing alike.
                compare_made(path.name, again, new, "created anew", known if again.labels else [])
            floats = pathlib.Path(made) / "floats.c3d"
            floats.unlink(missing_ok=True)
            if subprocess.run([dump, "floats", path, floats], check=False).returncode == 0 and floats.exists():
                found = difference(mine, ours(dump, floats))
                check(f"{path.name}: as floats", found is None, ": ".join(found or ()))
                known = [r for r in READERS if not any(entry[:2] == (path.name, r) for entry in DIFFERENCES)]
                compare_made(path.name, ours(dump, floats), floats, "as floats", known)
    print(f"{passed} passed, {failed} failed")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
