"""Writes what `--help` prints into docs/usage.md.

    python3 tests/python/usage.py target/release/mocap-repair docs/usage.md
"""

import os
import re
import subprocess
import sys


def main():
    program, path = sys.argv[1:]
    with open(path, encoding="utf-8") as file:
        text = file.read()

    def printed(match):
        words = match[1].split()
        environment = dict(os.environ, COLUMNS="100", NO_COLOR="1")
        run = subprocess.run([program, *words], capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL, env=environment)
        lines = "\n".join(line.rstrip() for line in run.stdout.rstrip().split("\n"))
        return f"```console\n$ mocap-repair {match[1]}\n{lines}\n```\n"

    text = re.sub(r"```console\n\$ mocap-repair ([^\n]*--help)\n.*?```\n", printed, text, flags=re.DOTALL)
    with open(path, "w", encoding="utf-8") as file:
        file.write(text)


if __name__ == "__main__":
    main()
