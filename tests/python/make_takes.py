"""Makes a folder of many takes, some of them bad: what batches are tried on.

    make_takes.py PROGRAM FOLDER NUMBER [SHARED_DATA]

Good takes are cuts and copies of real ones, if SHARED_DATA is there, and of the demonstration take. Their names collide when cases are ignored, have
blanks and letters beyond ASCII. One in fifty, and at least five, are bad: cut off, empty, some text, nothing ever seen, sizes that are declared and not there.
Writes which ones are bad to FOLDER.bad, one path on each line. The same arguments make the same files.
"""

import json
import random
import shutil
import struct
import subprocess
import sys
from pathlib import Path


def demo(program, folder, seed, frames):
    subprocess.run([program, "demo", "-o", folder, "--frames", str(frames), "--seed", str(seed), "--force"], check=True, stdout=subprocess.DEVNULL)
    return [Path(folder) / "walk-gaps.c3d", Path(folder) / "walk-gaps.csv"]


def rows(path, first, number, head):
    """A cut of a table: its head and some of its rows."""
    lines = path.read_text(encoding="utf-8", errors="surrogateescape").splitlines(keepends=True)
    return "".join(lines[:head] + lines[head + first : head + first + number]).encode("utf-8", errors="surrogateescape")


def copy_of(path):
    content = path.read_bytes()
    return lambda k: (path.suffix, content)


def cut_of(path):
    """Another cut for each take."""
    last = max(1, path.read_bytes().count(b"\n") - 130)
    return lambda k: (path.suffix, rows(path, k % min(last, 900), 60 + k % 60, 1))


def opens(program, path):
    """Real files are bad at times; here it is known which ones are."""
    told = subprocess.run([program, "inspect", "--json", path], capture_output=True, text=True)
    if told.returncode != 0:
        return False
    take = json.loads(told.stdout.splitlines()[-1])
    return any(marker["missing"] < take["frames"] for marker in take["markers"])


def all_missing(seen):
    """A table in which nobody is ever seen."""
    lines = seen.read_text().splitlines()
    columns = lines[0].count(",")
    return "\n".join([lines[0]] + [line.split(",")[0] + "," * columns for line in lines[1:]]).encode() + b"\n"


def huge(c3d):
    """Declares 65,535 markers in 65,535 frames, in its header and in its parameters."""
    content = bytearray(c3d.read_bytes())
    struct.pack_into("<H", content, 2, 65535)
    struct.pack_into("<HH", content, 6, 1, 65535)
    for name in (b"USED", b"FRAMES"):
        at = content.index(name) + len(name) + 2  # behind the name comes how far the next one is, then the type
        if content[at] == 4:
            struct.pack_into("<f", content, at + 2, 65535.0)
        else:
            struct.pack_into("<H", content, at + 2, 65535)
    return bytes(content)


def main(program, folder, number, shared=None):
    folder, number = Path(folder), int(number)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    base = folder.parent / (folder.name + ".base")
    makers = []
    for seed in range(1, 5):
        for path in demo(program, base / str(seed), seed, 60 + 30 * seed):
            makers.append(copy_of(path))
    table = base / "1" / "walk-gaps.csv"
    makers.append(lambda k: (".csv", rows(table, k % 50, 40, 1)))
    if shared and Path(shared).is_dir():
        shared = Path(shared)
        for path in sorted((shared / "cmu9").glob("*.csv")):
            makers.append(cut_of(path))
        small = [p for kind in ("c3d", "trc", "bvh", "tsv") for p in sorted((shared / kind).rglob(f"*.{kind}")) if p.stat().st_size < 120_000]
        makers.extend(copy_of(path) for path in small if opens(program, path))
    good_c3d = base / "1" / "walk-gaps.c3d"
    bad_makers = [
        lambda k: (".c3d", good_c3d.read_bytes()[: 600 + 997 * k]),
        lambda k: (".csv", b""),
        lambda k: (".c3d", f"This is no take, number {k}.\n".encode() * 9),
        lambda k: (".csv", all_missing(table)),
        lambda k: (".c3d", huge(good_c3d)),
    ]
    chance = random.Random(20)
    bad = set(chance.sample(range(number), max(5, number // 50)))
    folders = ["Session 1/cam A", "Session 1/cam B", "Søndag/Mål", "été 2026", "S3"]
    names = ["Walk {}", "walk {}", "WALK {}", "gå {}", "跑步 {}", "run#{}%20", "squat-{}", "Jump_{}"]
    written = []
    for k in range(number):
        # three names that are one where cases do not count
        stem = names[k % len(names)].format(k // (3 if k % len(names) < 3 else 1))
        suffix, content = bad_makers[sorted(bad).index(k) % len(bad_makers)](k % 7) if k in bad else makers[k % len(makers)](k)
        path = folder / folders[(k // 5) % len(folders)] / (stem + suffix)
        path.parent.mkdir(parents=True, exist_ok=True)
        while path.exists():
            path = path.with_name("again " + path.name)
        path.write_bytes(content)
        if k in bad:
            written.append(path.relative_to(folder).as_posix())
    (folder.parent / (folder.name + ".bad")).write_text("".join(path + "\n" for path in sorted(written)), encoding="utf-8")
    (folder / "notes.docx").write_bytes(b"no take")
    shutil.rmtree(base)
    print(f"{number} takes, {len(written)} of them bad, in {folder}")


if __name__ == "__main__":
    main(*sys.argv[1:])
