"""The Ray engine's driver, with a real Ray and a program that only plays `batch take`: what comes back, and what is left behind.

    check_ray.py FOLDER

FOLDER is made. Starts clusters on the loopback interface, kills parts of them, and ends only what it has started.
Prints a line per check, then `N passed, M failed`; exit code 1 if any failed.
"""

import collections
import contextlib
import hashlib
import json
import os
import pathlib
import queue
import secrets
import shutil
import signal
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
import traceback

DRIVER = pathlib.Path(__file__).resolve().parents[2] / "src/batch/engine/ray_driver.py"

# For anything that happens soon where nothing else runs.
PATIENCE_SECS = 60

# What stands in for the program: does what the name of the take says.
STAND_IN = '''#!%s -IS
import json, os, signal, sys, threading, time
take = json.loads(sys.stdin.readline())["take"]
words = take["path"].split()

def ends():
    sys.stdin.read()
    os._exit(9)

def say(**message):
    print(json.dumps(message), flush=True)

if "deaf" not in words:
    threading.Thread(target=ends, daemon=True).start()
if len(sys.argv) != 3 or sys.argv[1:] != ["batch", "take"]:
    os._exit(2)
began = time.time()
say(message_type="phase", text="reading " + take["path"])
for word in words:
    verb, _, value = word.partition("=")
    if verb == "pid":
        with open(value + ".part", "w") as file:
            file.write(str(os.getpid()) + " " + str(os.getppid()))
        os.rename(value + ".part", value)
    elif verb == "sleep":
        time.sleep(float(value))
    elif verb == "noise":
        sys.stderr.write("x" * int(value) + " the end")
        sys.stderr.flush()
        sys.stdout.write("no JSON\\n{\\n" + "y" * int(value) + "\\n")
    elif verb == "signal":
        os.kill(os.getpid(), int(value))
    elif verb == "oom":
        sys.stderr.write("memory allocation of 123 bytes failed\\n")
        sys.stderr.flush()
        os.abort()
    elif verb == "exit":
        os._exit(int(value))
code = {"bad": 65, "again": 75, "remarks": 3}.get(words[0], 0)
say(message_type="result", outcome=words[0], exit_code=code, path=take["path"], program=os.path.abspath(__file__), began=began, ended=time.time(),
    secrets=[name for name in os.environ if name.startswith("RAY_")])
sys.exit(code)
'''

# A cluster of nodes on this machine. Says its address; "more" adds a node, "fewer" kills the last one.
CLUSTER = '''
import json, signal, sys
from ray.cluster_utils import Cluster
nodes = json.loads(sys.argv[1])
cluster = Cluster(initialize_head=True, head_node_args=nodes[0], shutdown_at_exit=True)
added = [cluster.add_node(**node) for node in nodes[1:]]
print(cluster.address, flush=True)
for line in sys.stdin:
    cluster.remove_node(added.pop(), allow_graceful=False)
    print("fewer", flush=True)
cluster.shutdown()
'''

passed, failed = 0, 0


def check(name, fine, detail=""):
    """Counts and prints one check."""
    global passed, failed
    fine = bool(fine)
    passed, failed = passed + fine, failed + (not fine)
    print(f"{'ok     ' if fine else 'FAILED '} {name}{f': {detail}' if not fine else ''}", flush=True)


def until(what, patience=PATIENCE_SECS):
    """Waits until `what` is so, and tells whether it came to be."""
    end = time.monotonic() + patience
    while not (now := what()) and time.monotonic() < end:
        time.sleep(0.05)
    return now


def processes(session):
    """All processes of a session, by their numbers."""
    found = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            with contextlib.suppress(OSError, IndexError):
                fields = pathlib.Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()
                if int(fields[3]) == session and fields[0] != "Z":
                    found.append(int(entry))
    return found


def is_there(pid):
    with contextlib.suppress(OSError, IndexError):
        return pathlib.Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def command(pid):
    with contextlib.suppress(OSError):
        return pathlib.Path(f"/proc/{pid}/cmdline").read_bytes().decode("utf-8", "replace")
    return ""


def listening(pids):
    """Addresses at which these processes listen, as the system writes them."""
    sockets = set()
    for pid in pids:
        with contextlib.suppress(OSError):
            for handle in os.listdir(f"/proc/{pid}/fd"):
                with contextlib.suppress(OSError):
                    sockets.add(os.readlink(f"/proc/{pid}/fd/{handle}"))
    found = []
    for table in ("tcp", "tcp6"):
        for line in pathlib.Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and f"socket:[{fields[9]}]" in sockets:
                found.append(fields[1].rpartition(":")[0])
    return found


# 127.0.0.1 and ::ffff:127.0.0.1, as /proc/net writes them on a little-endian machine
LOOPBACK = {"0100007F", "0000000000000000FFFF00000100007F", "00000000000000000000000001000000"}


class Talk:
    """A driver and what is said with it."""

    open = []

    def __init__(self, start, python=(sys.executable, "-u"), first=None, **environment):
        base = {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}
        self.complaints = tempfile.TemporaryFile()
        self.process = subprocess.Popen([*python, str(DRIVER)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.complaints, text=True, env={**base, **environment})
        Talk.open.append(self)
        self.lines = queue.Queue()
        threading.Thread(target=self.read, daemon=True).start()
        self.ended, self.others, self.sent = {}, [], 0
        self.send(first or {"message_type": "start", **start})

    def read(self):
        for line in self.process.stdout:
            self.lines.put(json.loads(line))
        self.lines.put(None)

    def send(self, message):
        with contextlib.suppress(OSError):
            self.process.stdin.write(json.dumps(message) + "\n")
            self.process.stdin.flush()

    def hear(self, patience=PATIENCE_SECS):
        """The next message; None at the end or when there is none for long."""
        try:
            message = self.lines.get(timeout=patience)
        except queue.Empty:
            return None
        if message and message["message_type"] == "ended":
            if message["id"] in self.ended:
                check("a job ends once", False, message)
            self.ended[message["id"]] = message
        elif message:
            self.others.append(message)
        return message

    def job(self, name, timeout=None, memory=None, alone=False):
        self.sent += 1
        job = {"message_type": "job", "take": {"path": name}, "config": "größer\n"}
        self.send({"message_type": "job", "id": self.sent, "job": job, "timeout_secs": timeout, "memory_bytes": memory, "cpus": 1, "alone": alone})
        return self.sent

    def result(self, number):
        """How a job ended."""
        while number not in self.ended:
            if self.hear() is None:
                return collections.defaultdict(lambda: None)
        return self.ended[number]

    def error(self):
        message = self.hear() or {}
        return message.get("kind"), message.get("text", ""), self.process.wait(PATIENCE_SECS)

    def stop(self):
        self.send({"message_type": "stop"})
        return self.process.wait(PATIENCE_SECS)


def numbers(path):
    """What a take wrote of itself: its number and that of who started it."""
    until(path.exists)
    return [int(word) for word in path.read_text().split()]


def outcomes(talk):
    """Each way in which a take ends."""
    table = {
        "done": ("exit", 0, None), "remarks": ("exit", 3, None), "bad": ("exit", 65, None), "again": ("exit", 75, None),
        "done exit=1": ("exit", 1, None), "x signal=11": ("signal", None, 11), "x signal=9": ("signal", None, 9),
        "x oom": ("memory", None, 6), "x deaf sleep=1000": ("timeout", None, 9), "done noise=300000": ("exit", 0, None), "done größer/Maß": ("exit", 0, None),
    }
    numbered = {name: talk.job(name, timeout=3 if "1000" in name else 300) for name in table}
    for name, wanted in table.items():
        ended = talk.result(numbered[name])
        check(f"a take that is {name!r} ended {wanted[0]}", (ended["ended"], ended["code"], ended["signal"]) == wanted, ended)
        has_result = "signal" not in name and name.split()[-1] not in ("exit=1", "oom", "sleep=1000")
        check(f"a take that is {name!r} said what it did", (ended["result"] or {}).get("path") == (name if has_result else None), ended)
    late = talk.result(numbered["x deaf sleep=1000"])
    check("a late take is ended in time", 3 <= late["elapsed_secs"] < 30, late)
    noisy = talk.result(numbered["done noise=300000"])
    check("the end of what it complains is kept", len(noisy["stderr"]) == 4096 and noisy["stderr"].endswith("x the end"), noisy["stderr"][-50:])
    check("it is said where it ran", talk.result(numbered["done"])["node"] == socket.gethostname(), noisy)
    check("secrets of Ray are not for takes", talk.result(numbered["done"])["result"]["secrets"] == [], noisy["result"])


def local(program, folder):
    """A cluster that is started for the run, from its beginning to its end."""
    temp = pathlib.Path(tempfile.mkdtemp(prefix="t-", dir="/tmp"))  # short: sockets lie in it
    start = {"program": str(program), "program_sha256": hashlib.sha256(program.read_bytes()).hexdigest(), "address": None, "cpus": 2, "temp": str(temp)}
    began = time.monotonic()
    talk = Talk(start, RAY_ADDRESS="127.0.0.1:1", RAY_AUTH_TOKEN_PATH="/nowhere")
    ready = talk.hear() or {}
    print(f"        ready after {time.monotonic() - began:.1f} s")
    check("ready", ready.get("message_type") == "ready" and ready["cpus"] == 2 and ready["nodes"] == 1 and ready["ray"].startswith("2."), ready)
    outcomes(talk)

    own = processes(talk.process.pid)
    addresses = listening(own)
    check("everything that listens does so on the loopback interface", len(addresses) >= 5 and LOOPBACK.issuperset(addresses), addresses)
    token = next(word[15:] for word in pathlib.Path(f"/proc/{own[-1]}/environ").read_text().split("\0") if word.startswith("RAY_AUTH_TOKEN="))
    check("a token that is on no command line", len(token) == 64 and not any(token in command(pid) for pid in own))
    inside = next(temp.iterdir())
    check("a folder that nobody else can enter", stat.S_IMODE(inside.stat().st_mode) == 0o700, oct(inside.stat().st_mode))
    logs = [path for path in inside.rglob("*") if path.is_file()]
    check("the token is in no file", len(logs) > 5 and not any(token.encode() in path.read_bytes() for path in logs), logs)

    began = time.monotonic()
    many = [talk.job("done") for _ in range(300)]
    check("300 takes at once all come back", all(talk.result(number)["code"] == 0 for number in many))
    print(f"        {300 / (time.monotonic() - began):.0f} takes of a Python stand-in per second")

    # Ray's memory is what the machine had at the start: a task that wants all of it runs alone
    pairs = [[talk.job("done sleep=0.3", memory=1 << 50) for _ in range(2)], [talk.job("done sleep=0.3", alone=one) for one in (False, True)]]
    for what, pair in zip(("takes that want all memory", "a take that is to be alone"), pairs, strict=True):
        spans = sorted((talk.result(number)["result"]["began"], talk.result(number)["result"]["ended"]) for number in pair)
        check(f"{what}: one after another", spans[0][1] <= spans[1][0], spans)

    # a worker of Ray is killed; its take goes, though it does not listen; the other take stays
    victim, other = folder / "victim", folder / "other"
    numbered = [talk.job(f"x deaf pid={victim} sleep=1000"), talk.job(f"done pid={other} sleep=2")]
    (take, worker), _ = numbers(victim), numbers(other)
    check("the take runs under a worker of Ray", "ray::" in command(worker), command(worker))
    os.killpg(talk.process.pid, signal.SIGINT)
    os.kill(worker, signal.SIGKILL)
    lost = talk.result(numbered[0])
    check("a killed worker: its take is lost, with a reason", lost["ended"] == "lost" and "worker" in lost["stderr"], lost)
    check("a killed worker: the process of its take is gone", until(lambda: not is_there(take)))
    check("a killed worker: other takes go on", talk.result(numbered[1])["code"] == 0, talk.ended.get(numbered[1]))
    check("Ctrl-C ends nothing", talk.result(talk.job("done"))["code"] == 0)

    # all is gone after a stop in the midst of takes
    running = folder / "running"
    for _ in range(10):
        talk.job(f"x deaf pid={running} sleep=1000")
    take, _ = numbers(running)
    check("stop", talk.stop() == 0)
    check("stop: the processes of takes are gone", until(lambda: not is_there(take)))
    check("stop: Ray is gone", until(lambda: not processes(talk.process.pid)), [command(pid) for pid in processes(talk.process.pid)])
    check("stop: its folder is gone", not list(temp.iterdir()), list(temp.iterdir()))

    # all is gone after the driver was killed
    talk = Talk(start)
    killed = folder / "killed"
    talk.job(f"x deaf pid={killed} sleep=1000")
    take, _ = numbers(killed)
    talk.process.kill()
    began = time.monotonic()
    check("kill -9: the processes of takes are gone", until(lambda: not is_there(take)))
    check("kill -9: Ray is gone", until(lambda: not processes(talk.process.pid)), [command(pid) for pid in processes(talk.process.pid)])
    check("kill -9: its folder is gone", until(lambda: not list(temp.iterdir())), list(temp.iterdir()))
    print(f"        all gone {time.monotonic() - began:.1f} s after kill -9")
    talk = Talk(start)
    check("the next one starts", (talk.hear() or {}).get("message_type") == "ready")
    talk.process.terminate()
    check("SIGTERM is a stop", talk.process.wait(PATIENCE_SECS) == 0 and until(lambda: not processes(talk.process.pid)))
    shutil.rmtree(temp)



def elsewhere(program, folder):
    """A cluster that somebody else has started, with a token, two nodes, and no program on them."""
    sha256 = hashlib.sha256(program.read_bytes()).hexdigest()
    token, places = folder / "token", {"TMPDIR": str(folder / "tmp"), "HOME": str(folder / "home")}
    token.write_text(secrets.token_hex(32))
    token.chmod(0o600)
    (folder / "tmp/ray").mkdir(parents=True)  # where Ray writes down its clusters
    base = {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}
    ours = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN_PATH": str(token)}
    short = tempfile.mkdtemp(prefix="t-", dir="/tmp")
    node = {"num_cpus": 1, "include_dashboard": False, "object_store_memory": 100 << 20}
    nodes = [{**node, "memory": 1 << 30, "temp_dir": short}, {**node, "memory": 4 << 30}]
    cluster = subprocess.Popen(
        [sys.executable, "-c", CLUSTER, json.dumps(nodes)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=open(folder / "cluster.log", "wb"), text=True,
        start_new_session=True, env={**base, **ours, **places, "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0", "RAY_USAGE_STATS_ENABLED": "0"},
    )
    try:
        address = cluster.stdout.readline().strip()
        check("a cluster of two nodes", address.startswith("127.0.0.1:"), (folder / "cluster.log").read_text()[-2000:])
        check("it listens on the loopback interface too", LOOPBACK.issuperset(listening(processes(cluster.pid))))
        start = {"program": str(program), "program_sha256": sha256, "address": address, "cpus": None, "temp": None}
        strangers = [Talk(start, RAY_AUTH_MODE="token", RAY_AUTH_TOKEN="0" * 64), Talk(start, HOME=str(folder))]

        # a program that others could write is not run, but replaced by a copy that they cannot
        program.chmod(0o775)
        os.mkdir(planted := folder / "tmp" / f"mocap-repair-{os.geteuid()}-{sha256[:16]}", 0o777)
        planted.chmod(0o777)
        shutil.copy2("/bin/true", planted / "mocap-repair")
        talk = Talk(start, **ours)
        ready = talk.hear() or {}
        check("with the token: ready", ready.get("message_type") == "ready" and ready["cpus"] == 2 and ready["nodes"] == 2, ready)
        check("the driver listens on the loopback interface too", LOOPBACK.issuperset(listening(processes(talk.process.pid))))
        kept = folder / "home/.cache" / planted.name / "mocap-repair"
        many = [talk.job("done") for _ in range(20)]
        check("a shipped program runs everywhere", all((talk.result(number)["result"] or {}).get("program") == str(kept) for number in many), talk.ended)
        check("a shipped program is its owner's alone", [stat.S_IMODE(path.stat().st_mode) for path in (kept, kept.parent)] == [0o700, 0o700])
        kept.write_text("#!/bin/sh\necho somebody else's")
        check("a changed copy is replaced", talk.result(talk.job("done"))["code"] == 0 and kept.read_bytes() == program.read_bytes(), talk.ended)
        program.chmod(0o755)
        check("where the program is, it is used", talk.result(talk.job("done"))["result"]["program"] == str(program))

        # a node dies with a take, and another take waits for it that no other node has room for
        far, near = folder / "far", folder / "near"
        numbered = [talk.job(f"x deaf pid={far} sleep=1000", memory=3 << 30)]
        take, _ = numbers(far)
        numbered += [talk.job("done", memory=3 << 30), talk.job(f"done pid={near} sleep=1", memory=1 << 29)]
        numbers(near)
        print("fewer", file=cluster.stdin, flush=True)
        lost = talk.result(numbered[0])
        check("a node dies: its take is lost, with a reason", lost["ended"] == "lost" and lost["stderr"], lost)
        check("a node dies: the process of its take is gone", until(lambda: not is_there(take)))
        check("a node dies: takes elsewhere go on", talk.result(numbered[2])["code"] == 0, talk.ended)
        check("a node dies: what waited for it runs on another", talk.result(numbered[1])["code"] == 0, talk.ended)
        until(lambda: talk.others[-1]["message_type"] == "cpus" or not talk.hear(PATIENCE_SECS))
        check("a node dies: told", talk.others[-1] == {"message_type": "cpus", "cpus": 1}, talk.others)

        # the cluster is somebody else's and stays; takes go with who asked for them
        for end in ("stop", "kill"):
            running = folder / end
            talk.job(f"x deaf pid={running} sleep=1000")
            talk.job("x deaf sleep=1000")
            take, _ = numbers(running)
            talk.stop() if end == "stop" else talk.process.kill()
            check(f"{end}: the processes of takes are gone", until(lambda pid=take: not is_there(pid)))
            talk = Talk({**start, "address": address}, **ours)
            check(f"{end}: the cluster is still there", (talk.hear() or {}).get("cpus") == 1 and talk.result(talk.job("done"))["code"] == 0, talk.ended)
        talk.stop()
        for name, stranger in zip(("a wrong token", "no token"), strangers, strict=True):
            kind, text, code = stranger.error()
            check(f"{name}: no connection", kind == "no_cluster" and code == 1 and "RAY_AUTH_MODE=token" in text, text)
    finally:
        end_session(cluster)
        shutil.rmtree(short, ignore_errors=True)


def end_session(process):
    """Ends what we have started in a session of its own."""
    for pid in processes(process.pid):
        with contextlib.suppress(OSError):
            os.kill(pid, signal.SIGKILL)
    process.wait()


def refusals(program):
    """Where nothing can be run, and what is said then."""
    start = {"program": str(program), "program_sha256": "0" * 64, "address": None, "cpus": 1, "temp": None}
    kind, text, code = Talk(start, python=(sys.executable, "-I", "-S")).error()
    check("without Ray: told how to get it", kind == "no_ray" and code == 1 and f'{sys.executable} -m pip install "ray==' in text, text)
    for address in ("127.0.0.1:1", "ray://127.0.0.1:1", "somewhere"):
        kind, text, code = Talk({**start, "address": address}).error()
        check(f"nobody at {address}: told", kind == "no_cluster" and code == 1 and address in text, text)
    kind, text, code = Talk(None, first={"message_type": "stop"}).error()
    check("no start: told", kind == "driver" and code == 1, text)
    kind, text, code = Talk({**start, "program": "/nowhere"}).error()
    check("no program: told", kind == "driver" and code == 1 and "/nowhere" in text, text)
    # one that listens and says nothing: told later, while all else goes on
    deaf = socket.create_server(("127.0.0.1", 0))
    return deaf, Talk({**start, "address": f"127.0.0.1:{deaf.getsockname()[1]}"})


def main():
    if not sys.platform.startswith("linux"):
        print("ignored: what is left behind can be seen on Linux only")
        return
    folder = pathlib.Path(sys.argv[1]).resolve()
    folder.mkdir(parents=True)  # one that is there is somebody's
    program = folder / "stand-in"
    program.write_text(STAND_IN % sys.executable)
    program.chmod(0o755)
    began = time.monotonic()
    try:
        deaf, silent = refusals(program)
        for part in (local, elsewhere):
            try:
                part(program, folder)
            except Exception:  # the other part still tells something
                check("the checks go on to their end", False, traceback.format_exc())
            print(f"        {time.monotonic() - began:.0f} s")
        kind, text, code = silent.error()
        check("a cluster that does not answer: told in time", kind == "no_cluster" and code == 1 and "RAY_AUTH_MODE=token" in text, text)
        deaf.close()
    finally:
        for talk in Talk.open:
            if talk.process.poll() is None:
                talk.process.kill()
    print(f"{passed} passed, {failed} failed")
    sys.exit(failed > 0)


if __name__ == "__main__":
    main()
