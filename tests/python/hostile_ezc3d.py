"""How ezc3d takes the damaged files of tests/hostility: each file in a process of its own, because some of them end it.

    MOCAP_HOSTILITY_DUMP=FOLDER cargo test --test hostility
    python tests/python/hostile_ezc3d.py FOLDER

The figures are in docs/reliability.md.
"""

import collections
import multiprocessing
import pathlib
import resource
import sys

LIMIT_S = 10
LIMIT_BYTES = 2 << 30


def points(path):
    import ezc3d

    return ezc3d.c3d(str(path))["data"]["points"]


def judge(path, whole, queue):
    import numpy

    resource.setrlimit(resource.RLIMIT_AS, (LIMIT_BYTES, LIMIT_BYTES))
    try:
        found = points(path)
    except MemoryError:
        queue.put("wanted more than 2 GB")
        return
    except Exception:  # whatever it throws is a refusal
        queue.put("refused")
        return
    if not path.name.startswith("cut"):
        queue.put("opened")
    elif numpy.array_equal(found, points(whole), equal_nan=True):
        queue.put("opened, with the same points")
    else:
        queue.put("opened quietly with other points")


def main():
    folder = pathlib.Path(sys.argv[1])
    counts = collections.Counter()
    context = multiprocessing.get_context("fork")
    for path in sorted(folder.glob("*_*.c3d")):
        queue = context.Queue()
        process = context.Process(target=judge, args=(path, folder / "whole.c3d", queue))
        process.start()
        process.join(LIMIT_S)
        if process.is_alive():
            process.kill()
            process.join()
            outcome = f"took longer than {LIMIT_S} s"
        elif process.exitcode != 0:
            outcome = f"ended by signal {-process.exitcode}"
        else:
            outcome = queue.get()
        counts[f"{path.name.split('_')[0]}: {outcome}"] += 1
    for what, count in sorted(counts.items()):
        print(f"{what}: {count}")


main()
