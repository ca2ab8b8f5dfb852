"""How fast files are opened: by this project, by ezc3d, and by pandas, one after the other on the same files.

    python tests/python/bench_files.py

Builds and runs `cargo bench --bench files`. The figures are in docs/reliability.md. Run it on an idle machine, and look at ratios.
"""

import os
import pathlib
import subprocess
import tempfile
import time


def best(of, times=5):
    def once():
        start = time.perf_counter()
        of()
        return time.perf_counter() - start

    return min(once() for _ in range(times))


def main():
    import ezc3d
    import pandas

    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        environment = dict(os.environ, MOCAP_BENCH_FILES=str(folder))
        subprocess.run(["cargo", "bench", "--quiet", "--bench", "files"], env=environment, check=True)
        readers = [
            ("ezc3d, floats", "floats.c3d", lambda path: ezc3d.c3d(path)),
            ("ezc3d, integers", "integers.c3d", lambda path: ezc3d.c3d(path)),
            ("pandas, csv", "csv.csv", lambda path: pandas.read_csv(path)),
            ("pandas, trc", "trc.trc", lambda path: pandas.read_csv(path, sep="\t", skiprows=5, header=None)),
            ("pandas, tsv", "tsv.tsv", lambda path: pandas.read_csv(path, sep="\t", skiprows=11, header=None)),
        ]
        for name, file, read in readers:
            path = str(folder / file)
            seconds = best(lambda: read(path))
            print(f"{name}: {os.path.getsize(path) / 1e6:.0f} MB in {seconds:.2f} s, {os.path.getsize(path) / 1e6 / seconds:.0f} MB/s")


main()
