"""Runs the same batch in every way there is, kills whatever can be killed, and holds the trees against each other.

    check_batch.py PROGRAM FOLDER [--takes N] [--rounds N] [--many N] [--data SHARED_DATA]

The Python that runs this has to have Ray. Says how quick each way was; only trees, ledgers, exit codes and memory are judged.
The last line says how many checks passed and failed.
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import make_takes

OWN = ".mocap-repair"
passed = failed = 0


def check(what, holds, found=""):
    global passed, failed
    if holds:
        passed += 1
        print(f"ok {what}", flush=True)
    else:
        failed += 1
        print(f"not ok {what}: {found}", flush=True)


def tree(folder):
    """Everything but what is kept about running, by path."""
    found = {}
    for inside, folders, files in os.walk(folder):
        if OWN in folders:
            folders.remove(OWN)
        for name in files:
            path = Path(inside) / name
            found[path.relative_to(folder).as_posix()] = path.read_bytes()
    return found


def differences(one, other):
    names = sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))
    return f"{len(names)} of {len(one)}: {names[:5]}"


def leftovers(out):
    """Whatever a killed process may have left: files without their names, and folders to make them in."""
    own = out / OWN
    hidden = [p.as_posix() for p in out.rglob(".*") if OWN not in p.relative_to(out).parts]
    return hidden + [p.as_posix() for p in (own / "staging").rglob("*") if own.exists()]


def records(out):
    """All records of takes, ledger by ledger; a torn last line is none."""
    for ledger in sorted((out / OWN / "ledger").glob("*.jsonl")):
        for line in ledger.read_text(encoding="utf-8").splitlines():
            try:
                record = json.loads(line)
            except ValueError:
                continue
            if record["message_type"] == "take":
                yield record


def run(program, plan, out, *more, timeout=1800):
    began = time.monotonic()
    done = subprocess.run([program, "batch", "run", plan, "--out", out, "--quiet", *more], capture_output=True, text=True, timeout=timeout)
    return done.returncode, time.monotonic() - began, done.stderr


def processes(words):
    """Processes whose command line has all of these words."""
    found = []
    for process in Path("/proc").iterdir():
        if process.name.isdigit():
            try:
                line = (process / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            except OSError:
                continue
            if all(word in line for word in words):
                found.append(int(process.name))
    return found


def kill(pids, chance):
    if pids:
        try:
            os.kill(chance.choice(pids), signal.SIGKILL)
        except ProcessLookupError:
            return False
        return True
    return False


class Studio:
    """A folder of takes with its plan, and the tree that an undisturbed run makes of it."""

    def __init__(self, program, folder, takes, data):
        self.program, self.folder, self.number = program, folder, takes
        make_takes.main(program, folder / "takes", takes, data)
        self.bad = (folder / "takes.bad").read_text(encoding="utf-8").splitlines()
        self.plan = folder / "plan.jsonl"
        told = subprocess.run([program, "batch", "plan", folder / "takes", "-o", self.plan, "--json"], capture_output=True, text=True)
        planned = json.loads(told.stdout.splitlines()[-1])
        check("every take is planned, and names that collide are told", planned["takes"] == takes and planned["renamed"] > 0, told.stdout[-500:])

    def ways(self):
        """One machine, Ray, four shards: one tree."""
        out = self.folder / "local"
        code, secs, err = run(self.program, self.plan, out)
        print(f"local, on all cores: {self.number / secs:.2f} takes/s ({secs:.1f} s)")
        check("the local engine accounts for everything", code == 3, (code, err[-500:]))
        self.tree = tree(out)
        aside = {r["path"]: r["reason"] for r in records(out) if r["outcome"] == "quarantined"}
        check("the ledger names the bad takes, and no others", sorted(aside) == sorted(self.bad), (sorted(aside), self.bad))
        check("... with their reasons", all(aside.values()) and len(set(aside.values())) >= min(5, len(self.bad)), aside)
        for path, reason in sorted(aside.items()):
            print(f"   {path}: {reason}")
        good = [name for name in self.tree if name.endswith(".repair.json")]
        check("every other take has its output", len(good) == self.number - len(self.bad), len(good))
        check("nothing is left over", not leftovers(out), leftovers(out))

        out = self.folder / "one"
        code, secs_one, err = run(self.program, self.plan, out, "--jobs", "1")
        print(f"local, 1 job with all cores: {self.number / secs_one:.2f} takes/s ({secs_one:.1f} s); together they are {secs_one / secs:.2f} x as quick")
        check("one job at a time makes the same tree", tree(out) == self.tree, differences(tree(out), self.tree))
        shutil.rmtree(out)
        if shutil.which("taskset"):
            began = time.monotonic()
            subprocess.run(["taskset", "-c", "0", self.program, "batch", "run", self.plan, "--out", out, "--quiet", "--jobs", "1"], stderr=subprocess.DEVNULL)
            secs_one = time.monotonic() - began
            print(f"local, 1 job on one core: {self.number / secs_one:.2f} takes/s ({secs_one:.1f} s); together they are {secs_one / secs:.2f} x as quick")
            shutil.rmtree(out)

        out = self.folder / "ray"
        code, secs, err = run(self.program, self.plan, out, "--engine", "ray", "--jobs", "2", "--python", sys.executable)
        print(f"ray, 2 workers: {self.number / secs:.2f} takes/s ({secs:.1f} s)")
        check("Ray accounts for everything", code == 3, (code, err[-1500:]))
        check("Ray makes the same tree", tree(out) == self.tree, differences(tree(out), self.tree))
        check("Ray leaves nothing over", not leftovers(out), leftovers(out))
        shutil.rmtree(out)

        out, secs = self.folder / "shards", 0
        for shard in range(4):
            code, took, err = run(self.program, self.plan, out, "--shard", f"{shard}/4")
            secs += took
            check(f"shard {shard} of 4 accounts for its takes", code == 3, (code, err[-500:]))
        print(f"4 shards, one after the other: {self.number / secs:.2f} takes/s ({secs:.1f} s)")
        check("shards make the same tree", tree(out) == self.tree, differences(tree(out), self.tree))
        shutil.rmtree(out)

    def killed(self, rounds):
        """kill -9 at any moment of a driver, a take's process, a Ray worker, the Ray driver; then the same command again."""
        chance = random.Random(7)
        ray = ["--engine", "ray", "--jobs", "2", "--python", sys.executable]
        ways = [("the driver", [], None), ("a process of a take", [], "take"), ("a process of Ray", ray, "ray::"), ("the driver of a Ray run", ray, None),
                ("Ray's own driver", ray, "ray_driver.py")]
        for at in range(rounds):
            what, more, victim = ways[at % len(ways)]
            out = self.folder / f"killed-{at}"
            command = [self.program, "batch", "run", self.plan, "--out", out, "--quiet", *more]
            child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            # not before something runs, which takes Ray a while
            deadline = time.monotonic() + 120
            while not list((out / OWN / "staging").glob("*/*/*")) and child.poll() is None and time.monotonic() < deadline:
                time.sleep(0.01)
            time.sleep(chance.uniform(0.05, 2.0))
            if victim is None:
                child.kill()
                hit = child.wait() == -signal.SIGKILL
            else:
                words = {"take": [str(self.program), "batch take"], "ray::": ["ray::"], "ray_driver.py": ["ray_driver.py"]}[victim]
                # an agent of Ray takes its whole node along
                spared = processes(["Agent"])
                hit = False
                for _ in range(200):
                    if kill([pid for pid in processes(words) if pid not in spared], chance):
                        hit = True
                        break
                    time.sleep(0.01)
                code = child.wait(timeout=1200)
                # the driver has a guard of the same name, which may be missed; and what was done may have been all there was
                expected = (75, 3) if victim == "ray_driver.py" else (3,)
                check(f"round {at}: a run survives or says that it can go on when {what} is killed", code in expected, code)
            check(f"round {at}: {what} was hit", hit)
            before = [r["path"] for r in records(out) if r["outcome"] == "done"]
            code, _, err = run(self.program, self.plan, out, *more)
            check(f"round {at}: the same command goes on after {what} was killed", code == 3, (code, err[-800:]))
            check(f"round {at}: the tree is that of an undisturbed run", tree(out) == self.tree, differences(tree(out), self.tree))
            check(f"round {at}: no temporary files", not leftovers(out), leftovers(out))
            done = [r["path"] for r in records(out) if r["outcome"] == "done"]
            twice = len(done) - len(set(done))
            check(f"round {at}: no take was repaired twice ({len(before)} before, {len(done)} in all)", twice == 0, twice)
            shutil.rmtree(out)

    def full_disk(self):
        """A small disk in memory: says that it is full, puts nothing aside for it, and goes on when there is room."""
        if os.geteuid() != 0:
            print("ignored: only root can mount a small disk")
            return
        disk = Path(tempfile.mkdtemp(prefix="mocap-repair-disk-"))
        size = sum(len(content) for content in self.tree.values())
        if subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size // 3}", "tmpfs", disk]).returncode != 0:
            print("ignored: no small disk can be mounted here")
            return
        try:
            out = disk / "out"
            code, _, err = run(self.program, self.plan, out)
            check("a full disk ends the run", code == 75 and ("no room" in err.lower() or "space" in err.lower()), (code, err[-500:]))
            print(f"   {err.strip()[-300:]}")
            aside = [r for r in records(out) if r["outcome"] == "quarantined" and r["path"] not in self.bad]
            check("... puts no good take aside", not aside, aside[:2])
            check("... and leaves no temporary files", not leftovers(out), leftovers(out))
            half = tree(out)
            whole = all(content == self.tree[name] for name, content in half.items())
            check("... and nothing half written", whole and len(half) < len(self.tree), differences(half, self.tree))
            subprocess.run(["mount", "-o", f"remount,size={size * 2}", disk], check=True)
            code, _, err = run(self.program, self.plan, out)
            check("with room again the same command goes on", code == 3 and tree(out) == self.tree, (code, err[-500:]))
        finally:
            subprocess.run(["umount", disk])
            disk.rmdir()


def peak(program, plan, out):
    """The most memory that the driver takes, in KiB, and its exit code."""
    child = subprocess.Popen([program, "batch", "run", plan, "--out", out, "--quiet", "--jobs", "2"], stderr=subprocess.DEVNULL)
    most = together = 0
    while child.poll() is None:
        try:
            status = Path(f"/proc/{child.pid}/status").read_text()
            most = max(most, int(status.split("VmHWM:")[1].split()[0]))
            pids = [child.pid, *map(int, Path(f"/proc/{child.pid}/task/{child.pid}/children").read_text().split())]
            for task in Path(f"/proc/{child.pid}/task").iterdir():
                pids.extend(map(int, (task / "children").read_text().split()))
            resident = 0
            for pid in set(pids):
                try:
                    resident += int(Path(f"/proc/{pid}/status").read_text().split("VmRSS:")[1].split()[0])
                except (OSError, IndexError):
                    pass
            together = max(together, resident)
        except (OSError, IndexError):
            pass
        time.sleep(0.02)
    return most, together, child.returncode


def memory(program, folder, many):
    """A tenth of the takes takes the same memory."""
    subprocess.run([program, "demo", "-o", folder / "small", "--frames", "60"], check=True, stdout=subprocess.DEVNULL)
    content = (folder / "small" / "walk-gaps.c3d").read_bytes()
    (folder / "quick.toml").write_text('method = "linear"\n')
    measured = []
    for number in (many // 10, many):
        takes = folder / f"{number}"
        for k in range(number):
            (takes / f"{k % 50}").mkdir(parents=True, exist_ok=True)
            (takes / f"{k % 50}" / f"{k}.c3d").write_bytes(content)
        plan, out = folder / f"{number}.jsonl", folder / f"{number}-out"
        subprocess.run([program, "batch", "plan", takes, "-o", plan, "--config", folder / "quick.toml", "--no-log"], check=True, stdout=subprocess.DEVNULL)
        began = time.monotonic()
        most, together, code = peak(program, plan, out)
        secs = time.monotonic() - began
        print(f"{number} takes: driver {most} KiB, with its processes {together} KiB, {number / secs:.0f} takes/s")
        check(f"{number} small takes are repaired", code == 0, code)
        measured.append(most)
        shutil.rmtree(out)
        shutil.rmtree(takes)
    check(f"{many} takes want no more memory than {many // 10}", measured[1] <= 1.1 * measured[0], measured)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--takes", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--many", type=int, default=2000)
    parser.add_argument("--data")
    args = parser.parse_args()
    program, folder = args.program.resolve(), args.folder.resolve()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    studio = Studio(program, folder, args.takes, args.data)
    studio.ways()
    studio.killed(args.rounds)
    studio.full_disk()
    memory(program, folder, args.many)
    shutil.rmtree(folder, ignore_errors=True)
    print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
