"""The job files of docs/batch: what their commands make of the exit codes of `batch run`, with programs that only play.

    check_job_files.py FOLDER

FOLDER is made. Needs PyYAML and a shell; GNU parallel is used if it is there. No cluster: what was tested on one is said in each file.
Prints a line per check, then `N passed, M failed`; exit code 1 if any failed.
"""

import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

import yaml

FILES = pathlib.Path(__file__).resolve().parents[2] / "docs/batch"

PLAYERS = {
    # says how it was called, ends as it is told to, and stops when it has to, as the program does
    "mocap-repair": 'echo "$@" >>"$SAID"\ntrap "exit 75" TERM\nif [ "$CODE" = wait ]; then sleep 60 & wait $!; fi\nexit "$CODE"\n',
    "srun": 'while [ "${1#--}" != "$1" ]; do shift; done\nexec "$@"\n',
    "scontrol": 'echo "scontrol $*" >>"$SAID"\nexit 1\n',
    "aws": 'echo "aws $*" >>"$SAID"\n',
}

passed, failed = 0, 0


def check(name, fine, detail=""):
    """Counts and prints one check."""
    global passed, failed
    fine = bool(fine)
    passed, failed = passed + fine, failed + (not fine)
    print(f"{'ok     ' if fine else 'FAILED '} {name}{f': {detail}' if not fine else ''}", flush=True)


class Stage:
    """Where the players are."""

    def __init__(self, folder):
        self.said = folder / "said"
        for name, text in PLAYERS.items():
            (folder / name).write_text("#!/bin/sh\n" + text)
            (folder / name).chmod(0o755)
        self.base = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "SAID": str(self.said)}

    def play(self, command, code, **environment):
        """The exit code of the command, and what it called."""
        self.said.unlink(missing_ok=True)
        process = subprocess.Popen(command, env={**self.base, "CODE": str(code), **environment}, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        if code == "wait":
            end = time.monotonic() + 30
            while not (self.said.exists() and "batch run" in self.said.read_text()) and time.monotonic() < end:
                time.sleep(0.02)
            time.sleep(0.2)  # the traps are set
            process.send_signal(signal.SIGTERM)
        code = process.wait(60)
        return code, self.said.read_text() if self.said.exists() else ""


def containers(stage):
    """Kubernetes and AWS Batch: 3 is a success, everything else is told as it is, and the order to stop is handed on."""
    job = yaml.safe_load((FILES / "kubernetes.yaml").read_text())["spec"]
    container = job["template"]["spec"]["containers"][0]
    environment = {one["name"]: one["value"] for one in container["env"]}
    check("kubernetes: as many shards as completions", environment["SHARDS"] == str(job["completions"]))
    definition = json.loads((FILES / "aws-batch.json").read_text())
    properties = definition["containerProperties"]
    aws = {one["name"]: one["value"] for one in properties["environment"]}
    cases = {
        "kubernetes": (container["command"], {**environment, "JOB_COMPLETION_INDEX": "2"}, "--shard 2/8 "),
        "aws": (properties["command"], {**aws, "AWS_BATCH_JOB_ARRAY_INDEX": "2", "AWS_BATCH_JOB_ARRAY_SIZE": "8"}, "--shard 2/8 "),
        "aws, no array": (properties["command"], aws, "--shard 0/1 "),
    }
    shells = [shell for shell in ("sh", "dash", "bash") if shutil.which(shell)]
    for name, (command, given, shard) in cases.items():
        for shell in shells:
            for code in (0, 1, 2, 3, 75, 137, "wait"):
                got, said = stage.play([shell, *command[1:]], code, **given)
                wanted = {3: 0, "wait": 75}.get(code, code)
                check(f"{name}, {shell}: {code} becomes {wanted}", got == wanted and shard in said and said.count("batch run") == 1, (got, said))
    check("aws: the plan is fetched first", said.startswith("aws s3 cp --no-progress s3://bucket/plan.jsonl /tmp/plan.jsonl"), said)

    rules = job["podFailurePolicy"]["rules"]
    acts = {rule["action"]: rule.get("onExitCodes", {}).get("values") for rule in rules}
    check("kubernetes: 75 is counted and tried again, 2 ends the job", 75 in acts["Count"] and acts["FailJob"] == [2], acts)
    check("kubernetes: other codes give up a shard", set(acts["FailIndex"]) == {0, 2, *acts["Count"]}, acts)
    retry = definition["retryStrategy"]["evaluateOnExit"]
    check("aws: 75 is tried again, other codes are not", retry[0] == {"onExitCode": "75", "action": "RETRY"} and retry[-1]["action"] == "EXIT", retry)
    ray = yaml.safe_load((FILES / "kuberay.yaml").read_text())["spec"]
    check("kuberay: with a token", ray["authOptions"] == {"mode": "token"}, ray)


def slurm(stage):
    """Slurm: 3 is a success, 75 goes back into the queue by both its numbers, up to five times."""
    bash = shutil.which("bash")
    if bash is None:
        print("        slurm.sbatch is not looked at: bash is not here")
        return
    command = [bash, str(FILES / "slurm.sbatch")]
    array = {"SLURM_ARRAY_TASK_MIN": "0", "SLURM_ARRAY_TASK_MAX": "7", "SLURM_ARRAY_TASK_COUNT": "8", "SLURM_ARRAY_TASK_ID": "7"}
    given = {**array, "PLAN": "/a b/plan.jsonl", "OUT": "/o", "SLURM_ARRAY_JOB_ID": "9", "SLURM_JOB_ID": "9", "SLURM_MEM_PER_NODE": "1000", "SLURM_CPUS_PER_TASK": "4"}
    for code in (0, 1, 2, 3, 75):
        got, said = stage.play(command, code, **given)
        check(f"slurm: {code} becomes {0 if code == 3 else code}", got == (0 if code == 3 else code), (got, said))
        check(f"slurm: {code} is {'' if code == 75 else 'not '}put back", ("scontrol requeue 9_7\n" in said) == (code == 75), said)
    check("slurm: its call", said.startswith("batch run /a b/plan.jsonl --out /o --shard 7/8 --jobs 4 --memory 800M\n"), said)
    check("slurm: not for ever", "scontrol" not in stage.play(command, 75, **given, SLURM_RESTART_COUNT="5")[1])
    got, said = stage.play(command, 0, **{**given, "SLURM_ARRAY_TASK_MIN": "7", "SLURM_ARRAY_TASK_COUNT": "1"})
    check("slurm: an array with gaps is refused", got == 2 and not said, (got, said))


def parallel(stage):
    """GNU parallel: 3 is a success, 75 is tried twice more."""
    if shutil.which("parallel") is None:
        print("        parallel.sh is not looked at: GNU parallel is not here")
        return
    for code, calls, wanted in ((0, 2, 0), (3, 2, 0), (1, 2, 2), (75, 6, 2)):
        got, said = stage.play([str(FILES / "parallel.sh"), "2"], code, PLAN="/a b/plan.jsonl", OUT="/o")
        check(f"parallel: {code}", got == wanted and said.count("batch run /a b/plan.jsonl --out /o --shard ") == calls, (got, said))


def main():
    folder = pathlib.Path(sys.argv[1]).resolve()
    folder.mkdir(parents=True)  # one that is there is somebody's
    stage = Stage(folder)
    containers(stage)
    slurm(stage)
    parallel(stage)
    print(f"{passed} passed, {failed} failed")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
