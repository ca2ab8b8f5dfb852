#!/usr/bin/env python3
"""Opens what the program wrote with other people's readers, and holds it against the truth.

    check_outputs.py PROGRAM FOLDER

Makes the demonstration take in FOLDER, repairs it as C3D and as CSV, and reads the outputs with ezc3d, Python's csv, and mcap with protobuf.
Prints a line per check, then `N passed, M failed`; exit code 1 if any failed.
Nothing of the program is used for reading: an error that writer and reader share would show here.
"""

import csv
import math
import pathlib
import subprocess
import sys

import ezc3d
import numpy as np
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

# Filled samples of the demonstration take may be off by this much, mm: root mean square, and the worst one.
# Wide on purpose: this is about files. How good the methods are is measured in the Rust tests.
FILLED_RMS_MM = 15.0
FILLED_WORST_MM = 100.0

passed, failed = 0, 0


def check(name, fine, detail=""):
    """Counts and prints one check."""
    global passed, failed
    fine = bool(fine)
    passed, failed = passed + fine, failed + (not fine)
    print(f"{'ok     ' if fine else 'FAILED '} {name}{f': {detail}' if detail and not fine else ''}")


def read_c3d(path):
    """Labels, rate, and positions in mm as markers x frames x 3, NaN where missing."""
    c3d = ezc3d.c3d(str(path))
    point = c3d["parameters"]["POINT"]
    scale = {"mm": 1.0, "m": 1000.0}[point["UNITS"]["value"][0]]
    positions = np.moveaxis(c3d["data"]["points"][:3], 0, 2) * scale
    residuals = c3d["data"]["meta_points"]["residuals"][0]
    return point["LABELS"]["value"], point["RATE"]["value"][0], np.where(residuals[..., None] < 0, np.nan, positions), residuals


def read_csv(path):
    """The same from a wide table; the rate from its times."""
    with open(path, newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    times = np.array([float(row[head.index("time (s)")]) for row in rows])
    labels = [name.removesuffix("-x (mm)") for name in head if name.endswith("-x (mm)")]
    columns = [[head.index(f"{label}-{axis} (mm)") for axis in "xyz"] for label in labels]
    cell = lambda text: float(text) if text.strip() else math.nan
    positions = np.array([[[cell(row[c]) for c in three] for row in rows] for three in columns])
    return labels, (len(rows) - 1) / (times[-1] - times[0]), positions


def compare(name, labels, rate, repaired, gaps, truth, tolerance):
    """What was measured is as it was, and what was filled is near the truth."""
    measured = ~np.isnan(gaps).any(axis=2)
    check(f"{name}: shape, labels and rate", repaired.shape == truth[2].shape and labels == truth[0] and abs(rate - truth[1]) < 1e-3)
    check(f"{name}: the take has gaps", (~measured).sum() > 1000, f"{(~measured).sum()} missing samples")
    check(f"{name}: nothing is missing any more", not np.isnan(repaired).any())
    off = np.linalg.norm(repaired - truth[2], axis=2)
    check(f"{name}: measured samples equal the truth", (off[measured] <= tolerance).all(), f"off by up to {off[measured].max()} mm")
    filled = off[~measured]
    rms = float(np.sqrt((filled**2).mean()))
    check(f"{name}: filled samples are near the truth", rms < FILLED_RMS_MM and filled.max() < FILLED_WORST_MM, f"rms {rms:.1f}, worst {filled.max():.1f} mm")
    print(f"        filled: {filled.size} samples, median {np.median(filled):.2f}, rms {rms:.2f}, worst {filled.max():.2f} mm")


def check_log(path, frames, rate):
    """The log decodes, its topics agree with each other, and its metadata with the take."""
    with open(path, "rb") as file:
        kinds = {type(record).__name__ for record in StreamReader(file, validate_crcs=True).records}
    check("log: is whole, with statistics and metadata", {"Header", "Statistics", "Metadata", "DataEnd", "Footer"} <= kinds, str(kinds))
    messages, times = {}, []
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            messages.setdefault(channel.topic, []).append(decoded)
            times.append(message.log_time)
            stamp = getattr(decoded, "timestamp", None)  # transforms and scenes have theirs farther within
            stamp = message.log_time if stamp is None else stamp.seconds * 10**9 + stamp.nanos
            if stamp != message.log_time or message.publish_time != message.log_time:
                check("log: one time per message", False, f"{channel.topic} at {message.log_time}")
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}.get("mocap-repair")
        statistics = reader.get_summary().statistics
    check("log: messages are in the order of their times", times == sorted(times))
    check("log: statistics count them", statistics.message_count == len(times))
    topics = {"/em/likelihood", "/em/bone_residuals", "/take/bone_lengths", "/take/marker_state", "/markers/raw", "/markers/repaired", "/skeleton", "/log"}
    check("log: every topic has messages", set(messages) == topics, str(set(messages) ^ topics))
    of_frames = ["/take/bone_lengths", "/take/marker_state", "/markers/raw", "/markers/repaired", "/skeleton"]
    check("log: one message per frame", all(len(messages.get(topic, [])) == frames for topic in of_frames))
    likelihood, residuals = messages.get("/em/likelihood", []), messages.get("/em/bone_residuals", [])
    count = lambda of: [(m.stage, m.iteration, m.iteration_of_log) for m in of]
    check("log: both topics have the same iterations", count(likelihood) == count(residuals) and likelihood)
    check("log: iterations count up from 0", [m.iteration_of_log for m in likelihood] == list(range(len(likelihood))))
    check("log: likelihoods are numbers", all(math.isfinite(m.log_likelihood) for m in likelihood))
    last_of_stage = [a.stage != b.stage for a, b in zip(likelihood, likelihood[1:])] + [True]
    check("log: the sweeps are so many as they are, and do not converge", bool(likelihood) and not likelihood[-1].converged)
    check("log: only the last iteration of a stage does", all(last for m, last in zip(likelihood, last_of_stage) if m.converged))
    check("log: the body's model comes first, then the sweeps", sorted({m.stage for m in likelihood}) == [0, 1] and len(likelihood) > 3)
    labels = [[bone.label for bone in m.bones] for m in residuals]
    check("log: every message names the same bones", len(labels) > 1 and labels[0] and all(names == labels[0] for names in labels))
    check("log: no bone occurs twice", len(set(labels[0])) == len(labels[0]))
    check("log: bone errors are numbers", all(math.isfinite(b.value) and 0 <= b.value <= b.max_mm for m in residuals for b in m.bones))
    check("log: frames and iterations are a frame period apart", sorted(set(times)) == [round(k * 1e9 / rate) for k in range(max(frames, len(likelihood)))])
    expected = {"frames": str(frames), "method": "auto", "source_name": "walk-gaps.c3d", "iterations": str(len(likelihood)), "stage.1.stop_reason": "complete"}
    check("log: has its metadata", metadata is not None and expected.items() <= metadata.items(), str(metadata))


def main():
    """Runs the program, then the checks."""
    program, folder = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    run = lambda *arguments: subprocess.run([program, *arguments], cwd=folder, check=False, stdout=subprocess.DEVNULL).returncode
    check("demo", run("demo", "-o", ".", "--force") == 0)
    check("repair a C3D", run("walk-gaps.c3d", "-o", "walk.c3d", "--fills", "fills.csv", "--force") == 0)
    check("repair a CSV", run("walk-gaps.csv", "-o", "walk-table.csv", "--force") == 0)
    check("repair a CSV into a C3D", run("walk-gaps.csv", "-o", "walk-new.c3d", "--force") in (0, 3))

    truth = read_c3d(folder / "walk-truth.c3d")[:3]
    gaps = read_c3d(folder / "walk-gaps.c3d")
    for name in ("walk.c3d", "walk-new.c3d"):
        labels, rate, repaired, residuals = read_c3d(folder / name)
        compare(name, labels, rate, repaired, gaps[2], truth, 0.0)
        hidden = np.isnan(gaps[2]).any(axis=2)
        check(f"{name}: filled samples do not pass for measured ones", (residuals[hidden] == 0).all())
    before, after = ezc3d.c3d(str(folder / "walk-gaps.c3d")), ezc3d.c3d(str(folder / "walk.c3d"))
    same = all(
        np.array_equal(parameter["value"], after["parameters"][group][name]["value"])
        for group, parameters in before["parameters"].items()
        for name, parameter in parameters.items()
        if isinstance(parameter, dict) and "value" in parameter
    )
    check("walk.c3d: every parameter is as it was", same and set(before["parameters"]) == set(after["parameters"]))

    table_gaps, table_truth = read_csv(folder / "walk-gaps.csv"), read_csv(folder / "walk-truth.csv")
    compare("walk-table.csv", *read_csv(folder / "walk-table.csv"), table_gaps[2], table_truth, 0.0)
    check("the demonstration is the same as C3D and as CSV", np.allclose(table_truth[2], truth[2], atol=1e-3, rtol=0) and table_truth[0] == truth[0])

    with open(folder / "fills.csv", newline="", encoding="utf-8") as file:
        fills = list(csv.DictReader(file))
    repaired = read_c3d(folder / "walk.c3d")[2]
    hidden = {(truth[0][m], f) for m, f in zip(*np.nonzero(np.isnan(gaps[2]).any(axis=2)))}
    check("fills.csv: a row for each missing sample", len(fills) == len(hidden) and {(r["marker"], int(r["frame_index"])) for r in fills} == hidden)
    far = max(
        float(np.abs(repaired[truth[0].index(r["marker"]), int(r["frame_index"])] - [float(r[axis]) for axis in "xyz"]).max()) for r in fills
    )
    check("fills.csv: has the positions of walk.c3d", far < 1e-3, f"off by {far} mm")
    check("fills.csv: every row knows its error", all(float(r["sigma_mm"]) > 0 for r in fills))

    check_log(folder / "walk.mcap", repaired.shape[1], truth[1])
    print(f"{passed} passed, {failed} failed")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
