#!/usr/bin/env python3
"""Reads real BVH files with this project and with a forward kinematics of other people, and holds the joints against each other.

    check_bvh.py DUMP SHARED [--markdown]

DUMP is the example program `dump`; SHARED has `data/bvh/*.bvh` and the other forward kinematics, `tools/bvh_joints.py`.
Joints are matched by name, lengths are those of the file. Where the other is known to differ, DIFFERENCES says why ours is right:
such a file must differ, so that the table cannot outlive its reasons. `--markdown` prints the table for docs/formats/differences.md.
Prints a line per check, then `N passed, M failed`; exit code 1 if any failed. Without the folder or numpy it says so and exits with 0.
"""

import json
import pathlib
import subprocess
import sys

try:
    import numpy as np
except ImportError as absent:
    np = None
    reason = str(absent)

ROOM = (
    "positions of joints are in the room: taken so, the bones of the first frame have the lengths of their OFFSETs; taken as relative to their "
    "parents, as the other does, they are metres long"
)
# File and why ours is right.
DIFFERENCES = {
    "5a7307_animdraw_BVH_cmu_new2_dance002.bvh": ROOM,
    "animdraw_BVH_cmu_new2_dance002.bvh": ROOM,
    "makehuman-assets__base_poses_fight01.bvh": "position channels of joints below the root are all 0, and are added to the OFFSETs: taken in "
    "their place, as the other does, all bones would have no length",
}
# Lengths as shares of the largest coordinate.
SAME = 1e-9


def ours(dump, path):
    done = subprocess.run([dump, "take", str(path)], capture_output=True, check=True)
    head, data = done.stdout.split(b"\n", 1)
    head = json.loads(head)
    count = head["frames"] * len(head["labels"])
    positions = np.frombuffer(data, "<f8", 3 * count).reshape(head["frames"], len(head["labels"]), 3) / head["unit_mm"]
    return head["labels"], positions


def main():
    dump, shared = sys.argv[1], pathlib.Path(sys.argv[2])
    if "--markdown" in sys.argv:
        print("| file | why ours is right |\n| --- | --- |")
        for file, why in DIFFERENCES.items():
            print(f"| {file} | {why} |")
        return 0
    files = sorted((shared / "data" / "bvh").glob("*.bvh"))
    if np is None or not files or not (shared / "tools" / "bvh_joints.py").exists():
        print(f"ignored: NO BVH WAS COMPARED: {reason if np is None else f'no files or no tools/bvh_joints.py in {shared}'}")
        return 0
    sys.path.insert(0, str(shared / "tools"))
    import bvh_joints

    passed = failed = 0
    for path in files:
        labels, positions = ours(dump, path)
        theirs = bvh_joints.joints(path)
        both = [name for name in theirs if labels.count(name) == 1]
        problem = None
        if not both:
            problem = "no joint in common"
        else:
            at = [labels.index(name) for name in both]
            expected = np.stack([theirs[name] for name in both], 1)
            frames = min(len(expected), len(positions))
            scale = max(1.0, np.abs(expected).max())
            off = np.abs(positions[:frames, at] - expected[:frames]).max() / scale
            differs = off > SAME
            if differs != (path.name in DIFFERENCES):
                problem = f"off by {off:.2e} of {scale:.1f}" + (", but listed as different" if path.name in DIFFERENCES else "")
        if problem:
            failed += 1
            print(f"FAILED {path.name}: {problem}")
        else:
            passed += 1
            print(f"ok {path.name}: {len(both)} joints, {frames} frames, off by {off:.1e}")
    print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


sys.exit(main())
