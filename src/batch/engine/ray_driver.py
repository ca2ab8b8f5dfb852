"""Runs takes as tasks of Ray. The program writes this file to a temporary folder, starts it, and talks to it in lines of JSON.

    python3 -u ray_driver.py

Standard input: `start` once, then `job` for each take, then `stop` or the end. Standard output: `ready` or `error`, then `ended`
for each job in the order in which they end, and `cpus` whenever the cluster has grown or shrunk. Everything else goes to standard
error. What is tried again, how many takes are on their way at once, and what a failure means is not decided here.

Without an address a cluster is started on this machine. It listens on the loopback interface only, wants a token that nobody else
knows, and is gone when this process is, however that ends. A cluster with an address is somebody else's: it is used and left.

Each job is one task that runs the program once, as `batch take`. A task is never run again by Ray.
"""

import contextlib
import hashlib
import json
import os
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

# The version that this was tried with, and the oldest one that knows tokens.
TRIED = "2.60.0"
OLDEST = (2, 52)

# How long a cluster may take to answer, and how often it is asked what it has, seconds.
PATIENCE_SECS = 60.0
CONNECT_SECS = 10.0
POLL_SECS = 3.0

# How much of the end of standard error is kept, and how much of that of standard output is searched for the result, bytes.
STDERR_KEPT = 4096
STDOUT_KEPT = 4 << 20

# The object store of a cluster on this machine, bytes: results are passed on without it, only a copy of the program ever lies there.
SMALLEST_STORE = 100 << 20

# Sockets of Ray lie below its folder, and the path of a socket has 107 bytes: Ray itself wants 66 of them.
LONGEST_FOLDER = 107 - 66


# ---- What runs on the nodes -----------------------------------------------------------------------------------------------------

# Files whose hash this worker process has found right: by path, what `stat` said of them then.
known = {}


def is_program(path, sha256):
    """Whether the file at `path` can be run, belongs to nobody who could not run things here anyway, and is the program."""
    try:
        found = os.stat(path)
        if not stat.S_ISREG(found.st_mode) or found.st_uid not in (0, os.geteuid()) or found.st_mode & 0o022:
            return False
        identity = (found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)
        if known.get(path) == identity:
            return True
        if not os.access(path, os.X_OK):  # on a file system that runs nothing, for example
            return False
        digest = hashlib.sha256()
        with open(path, "rb") as file:
            while piece := file.read(1 << 20):
                digest.update(piece)
    except OSError:
        return False
    if digest.hexdigest() != sha256:
        return False
    known[path] = identity
    return True


def program_here(program, sha256, shipped):
    """Where the program is on this node. `shipped`: a reference to its bytes, or None. None if the bytes are needed."""
    if is_program(program, sha256):
        return program
    refused = []
    for place in (tempfile.gettempdir(), os.path.join(os.path.expanduser("~"), ".cache")):
        folder = os.path.join(place, f"mocap-repair-{os.geteuid()}-{sha256[:16]}")
        path = os.path.join(folder, "mocap-repair")
        try:
            os.makedirs(place, exist_ok=True)
            with contextlib.suppress(FileExistsError):
                os.mkdir(folder, 0o700)
            found = os.lstat(folder)
            if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid() or found.st_mode & 0o077:
                refused.append(f"{folder} is not a folder that only user {os.geteuid()} can use; remove it")
                continue
            if is_program(path, sha256):
                return path
            if shipped is None:
                return None
            code = ray.get(shipped[0])
            if hashlib.sha256(code).hexdigest() != sha256:
                raise RuntimeError("the program that came to this node is not the one that was sent")
            handle, part = tempfile.mkstemp(dir=folder)
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(code)
                    os.fchmod(file.fileno(), 0o700)
                os.replace(part, path)
            except BaseException:
                os.unlink(part)
                raise
            if is_program(path, sha256):
                return path
            refused.append(f"{path} cannot be run")
        except OSError as e:
            refused.append(f"{place}: {e}")
    raise RuntimeError(f"{program} is not on {socket.gethostname()}, and there is no place for it: {'; '.join(refused)}")


def tied():
    """Words before a command that let the system end it together with this process. Where there are none, it sees its input end."""
    if "tied" not in known:
        words = ["setpriv", "--pdeathsig", "KILL", "--"]
        try:
            subprocess.run([*words, "true"], check=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        except (OSError, subprocess.CalledProcessError):
            words = []
        known["tied"] = words
    return known["tied"]


def end_of(file, most):
    """The last bytes of a file that another process has written."""
    file.seek(max(0, file.seek(0, os.SEEK_END) - most))
    return file.read()


def result_in(said):
    """The last line that is a result, or None."""
    for line in reversed(said.split(b"\n")):
        with contextlib.suppress(ValueError, AttributeError):
            if (message := json.loads(line)).get("message_type") == "result":
                return message
    return None


def run_take(program, sha256, shipped, line, timeout):
    """One take: what the task does. Returns what `ended` says of it, or None if the program has to be sent first."""
    path = program_here(program, sha256, shipped)
    if path is None:
        return None
    began = time.monotonic()
    # secrets of the cluster are not for the program
    environment = {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        # no preexec_fn: it would run Python, and what gRPC does at a fork, in a copy of a process with many threads
        child = subprocess.Popen([*tied(), path, "batch", "take"], stdin=subprocess.PIPE, stdout=out, stderr=err, env=environment)
        late = threading.Event()
        clock = threading.Timer(timeout or 0, lambda: (late.set(), child.kill()))
        try:
            if timeout is not None:
                clock.start()
            with contextlib.suppress(BrokenPipeError):  # it has ended already, and how will be seen
                child.stdin.write(line)
                child.stdin.flush()
            code = child.wait()
        finally:
            clock.cancel()
            child.kill()
            with contextlib.suppress(BrokenPipeError):
                child.stdin.close()
        complaint = end_of(err, STDERR_KEPT).decode("utf-8", "replace").strip()
        result = result_in(end_of(out, STDOUT_KEPT))
    is_late = late.is_set() and code == -signal.SIGKILL
    # a program in Rust ends by a signal if the system gives no memory, and says so
    short = code < 0 and "memory allocation of" in complaint
    return {
        "ended": "timeout" if is_late else "memory" if short else "signal" if code < 0 else "exit",
        "code": code if code >= 0 else None,
        "signal": -code if code < 0 else None,
        "result": result,
        "stderr": complaint,
        "elapsed_secs": round(time.monotonic() - began, 6),
        "node": socket.gethostname(),
    }


# ---- What runs here -------------------------------------------------------------------------------------------------------------


class Failure(Exception):
    """Why nothing can be run: `kind` is for the program, the text for people."""

    def __init__(self, kind, text):
        super().__init__(text)
        self.kind = kind


class Cluster:
    """The connection to Ray; leaving it ends what was started for it."""

    def __init__(self, start):
        self.address = start.get("address")
        self.folder = None
        self.cpus = start.get("cpus")
        self.store = max(SMALLEST_STORE, 2 * os.path.getsize(start["program"]))
        if self.address is None:
            for name in ("RAY_ADDRESS", "RAY_AUTH_TOKEN_PATH", "RAY_REDIS_ADDRESS", "RAY_TMPDIR"):
                os.environ.pop(name, None)
            # Anybody on this machine could give tasks to a cluster without a token. This one never touches a disk.
            os.environ.update(RAY_AUTH_MODE="token", RAY_AUTH_TOKEN=secrets.token_hex(32))
            self.folder = own_folder(start.get("temp"))
            self.guard = guarded(self.folder)
        if self.address is None or is_loopback(self.address):
            # Ray replaces loopback addresses by that of the network, and then listens everywhere, unless it is told that there is no network
            os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
        os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")

    def connect(self):
        quiet = {"log_to_driver": False, "logging_level": "ERROR"}
        if self.address is None:
            own = {"num_cpus": self.cpus, "include_dashboard": False, "object_store_memory": self.store, "_temp_dir": os.path.join(self.folder, "r")}
            ray.init(address="local", _node_ip_address="127.0.0.1", **own, **quiet)
            here = ray.get_runtime_context().gcs_address
            if not here.startswith("127."):
                raise Failure("driver", f"Ray listens on {here}, and should on 127.0.0.1 only; install the version that this was tried with: {pip_line()}")
            return here
        host, _, port = self.address.removeprefix("ray://").rpartition(":")
        if self.address != "auto":
            if not host or not port.isdigit():
                raise Failure("no_cluster", f"{self.address!r} is no address of a Ray cluster; expected auto, host:port or ray://host:port")
            try:
                socket.create_connection((host.strip("[]"), int(port)), CONNECT_SECS).close()
            except OSError as e:
                raise Failure("no_cluster", f"no Ray cluster answers at {self.address}: {e}; is it running, and is it reached from here?") from None
        ray.init(address=self.address, **quiet)
        return self.address if self.address != "auto" else ray.get_runtime_context().gcs_address

    def close(self):
        with contextlib.suppress(Exception):
            ray.shutdown()
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


def is_loopback(address):
    if address == "auto":
        with contextlib.suppress(OSError), open(os.path.join(os.environ.get("RAY_TMPDIR", "/tmp"), "ray", "ray_current_cluster"), encoding="utf-8") as file:
            address = file.read()
    return address.removeprefix("ray://").rpartition(":")[0] in ("127.0.0.1", "localhost", "[::1]")


def own_folder(temp):
    """A folder for a cluster on this machine that only this user can enter: Ray opens its own to everybody."""
    place = os.path.realpath(temp or tempfile.gettempdir())
    if len(os.fsencode(os.path.join(place, "mocap-ray-12345678"))) > LONGEST_FOLDER:
        print(f"{place} is too long a path for the sockets of Ray; /tmp is used", file=sys.stderr)
        place = "/tmp"
    return tempfile.mkdtemp(prefix="mocap-ray-", dir=place)


def guarded(folder):
    """Ends what Ray has started when this process is gone, however it ended: some of it would stay for a minute. Has to come before any thread."""
    group = os.getpgrp()
    if group != os.getpid():
        return None
    end, ours = os.pipe()
    if os.fork():
        os.close(end)
        return ours  # open as long as this process is there, and nobody else has it
    os.setsid()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    os.dup2(end, 0)
    os.closerange(1, 1024)
    os.read(0, 1)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)
    for _ in range(10):  # workers, which are on their own, see a little later that Ray is gone
        if os.path.exists(folder):
            shutil.rmtree(folder, ignore_errors=True)
            time.sleep(1)
    os._exit(0)


def pip_line():
    return f'{sys.executable} -m pip install "ray=={TRIED}"'


def rounded_up(size):
    """Ray plans tasks of the same needs together, so needs are rounded: up, by at most a quarter, to one of a few dozen values."""
    step = 1 << max(size.bit_length() - 3, 20)
    return -(-size // step) * step


class Driver:
    """Jobs that are on their way."""

    def __init__(self, start, events, say):
        self.program, self.sha256 = start["program"], start["program_sha256"]
        # opened now, so that it can be sent even if another version is installed in the meantime
        self.file = open(self.program, "rb")  # noqa: SIM115
        self.events, self.say = events, say
        self.shipped = None
        self.running = {}  # id -> (message, reference, what it wants, when it was handed in)
        self.nodes = []  # (processors, memory) of each node that has processors
        self.task = ray.remote(max_retries=0, num_cpus=1)(run_take)

    def wants(self, message):
        """Processors and memory of a task: no more than some node has, or it would wait for ever."""
        cpus, memory = message.get("cpus") or 1, message.get("memory_bytes") or 0
        if not self.nodes:
            return cpus, rounded_up(memory)
        if message.get("alone"):
            most, cpus = max((memory, cpus) for cpus, memory in self.nodes)
            return cpus, int(most)
        cpus = min(cpus, max(cpus for cpus, _ in self.nodes))
        return cpus, min(rounded_up(memory), int(max(most for has, most in self.nodes if has >= cpus)))

    def submit(self, message):
        number, wanted = message["id"], self.wants(message)
        line = (json.dumps(message["job"]) + "\n").encode()
        try:
            reference = self.task.options(num_cpus=wanted[0], memory=wanted[1] or None).remote(
                self.program, self.sha256, self.shipped, line, message.get("timeout_secs")
            )
            self.running[number] = (message, reference, wanted, time.monotonic())
            reference.future().add_done_callback(lambda future: self.events.put(("done", (number, reference, future))))
        except Exception as e:  # the connection is gone, for example
            self.running[number] = (message, None, wanted, time.monotonic())
            self.lost(number, e)

    def done(self, number, reference, future):
        message, current, _, _ = self.running.get(number, (None, None, None, None))
        if message is None or current is not reference:  # handed in again in the meantime
            return
        error = future.exception()
        if error is not None:
            self.lost(number, error)
            return
        ended = future.result()
        if ended is not None:
            del self.running[number]
            self.say(message_type="ended", id=number, **ended)
            return
        try:
            self.ship()
        except (OSError, Failure, ray.exceptions.RayError) as e:
            self.lost(number, e)
        else:
            self.submit(message)

    def ship(self):
        """The program for nodes that do not have it; all further tasks can take it from the object store."""
        if self.shipped is None:
            self.file.seek(0)
            code = self.file.read()
            if hashlib.sha256(code).hexdigest() != self.sha256:
                raise Failure("driver", f"{self.program} has changed since it was started, and cannot be sent to other nodes")
            self.shipped = [ray.put(code)]

    def lost(self, number, error):
        """A task that came to no end of its own."""
        *_, since = self.running.pop(number)
        ended = "memory" if isinstance(error, ray.exceptions.OutOfMemoryError) else "lost"
        cause = getattr(error, "cause", None) or error
        text, elapsed = f"{type(cause).__name__}: {cause}"[:STDERR_KEPT], round(time.monotonic() - since, 6)
        self.say(message_type="ended", id=number, ended=ended, code=None, signal=None, result=None, stderr=text, elapsed_secs=elapsed, node=None)

    def seen(self, nodes):
        """The cluster is as it is now. What waits for a node that is gone is handed in again, for what is left."""
        self.nodes = nodes
        for message, reference, (cpus, memory), _ in list(self.running.values()) if nodes else []:
            if not any(has >= cpus and most >= memory for has, most in nodes):
                ray.cancel(reference, force=True)
                self.submit(message)


def nodes_now():
    """Processors and memory of each node that is there and has processors, and how many nodes there are."""
    alive = [node["Resources"] for node in ray.nodes() if node.get("Alive")]
    return [(has["CPU"], has.get("memory", 0.0)) for has in alive if has.get("CPU")], len(alive)


def watch(events):
    """Asks again and again what the cluster has."""
    while True:
        time.sleep(POLL_SECS)
        try:
            events.put(("nodes", nodes_now()))
        except Exception as e:
            events.put(("gone", e))
            return


def listen(lines, events):
    with contextlib.suppress(ValueError, AttributeError):  # a line that is no message is the end too
        for line in lines:
            message = json.loads(line)
            events.put((message.get("message_type"), message))
    events.put(("stop", None))


def import_ray():
    global ray
    try:
        import ray
        import ray.exceptions
    except ImportError as e:
        raise Failure("no_ray", f"{sys.executable} has no Ray: {e}; expected Ray {TRIED}: {pip_line()}") from None
    if tuple(int(part) for part in ray.__version__.split(".")[:2]) < OLDEST:
        raise Failure("no_ray", f"{sys.executable} has Ray {ray.__version__}, which knows no tokens; expected Ray {TRIED}: {pip_line()}")


def why_not(error, address):
    """Why there is no connection, with the way out. Ray never tells the token."""
    text = " ".join(str(error).split())[:1000]
    if address is None:
        return f"no Ray cluster on this machine: {text}"
    out = "if it wants a token, set RAY_AUTH_MODE=token and have the token in the file that RAY_AUTH_TOKEN_PATH names, or in ~/.ray/auth_token"
    versions = f"Ray {ray.__version__} and Python {sys.version.split()[0]} have to be the same there"
    return f"no connection to the Ray cluster at {address}: {text}; {out}; {versions}"


def connected(cluster, say):
    """The address of the cluster and what it has; ends everything if that takes too long."""

    def too_late():
        say(message_type="error", kind="no_cluster", text=why_not(f"no answer in {PATIENCE_SECS:.0f} s", cluster.address))
        os._exit(1)

    alarm = threading.Timer(PATIENCE_SECS, too_late)
    alarm.daemon = True
    alarm.start()
    try:
        return (cluster.connect(), *nodes_now())
    except Failure:
        raise
    except BaseException as e:
        raise Failure("no_cluster", why_not(e, cluster.address)) from None
    finally:
        alarm.cancel()


def drive(lines, events, say):
    try:
        start = json.loads(next(lines, "null"))
        if not isinstance(start, dict) or start.get("message_type") != "start":
            raise Failure("driver", "the first line of standard input is no start message")
        cluster = Cluster(start)
        threading.Thread(target=listen, args=(lines, events), daemon=True).start()
    except (ValueError, KeyError, OSError) as e:
        raise Failure("driver", f"cannot begin: {type(e).__name__}: {e}") from None
    try:
        import_ray()
        address, has, alive = connected(cluster, say)
        catch_signals(events)  # Ray has put its own in their place
        driver = Driver(start, events, say)
        driver.nodes = has
        cpus = int(sum(cpus for cpus, _ in has))
        say(message_type="ready", ray=ray.__version__, address=address, cpus=cpus, nodes=alive)
        threading.Thread(target=watch, args=(events,), daemon=True).start()
        while True:
            event, value = events.get()
            if event == "job":
                driver.submit(value)
            elif event == "done":
                driver.done(*value)
            elif event == "nodes":
                has, alive = value
                if cluster.address is None and not has:
                    raise Failure("no_cluster", "the Ray cluster on this machine is gone")
                if has != driver.nodes:
                    driver.seen(has)
                if (now := int(sum(cpus for cpus, _ in has))) != cpus:
                    cpus = now
                    say(message_type="cpus", cpus=cpus)
            elif event == "gone":
                raise Failure("no_cluster", why_not(value, cluster.address))
            else:
                break
            del event, value  # or the last result would be kept until the next one
    finally:
        cluster.close()


def catch_signals(events):
    """Ctrl-C goes to everybody at the terminal: what it means is decided by whoever started this. SIGTERM is an order to stop."""
    signal.signal(signal.SIGINT, lambda *_: None)  # not SIG_IGN, which processes of Ray would inherit
    signal.signal(signal.SIGTERM, lambda *_: events.put(("stop", None)))


def main():
    # Nobody but this process speaks and hears on the pipes to the program, whatever Ray starts.
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    lines = iter(os.fdopen(os.dup(0), "r", encoding="utf-8"))
    os.dup2(2, 1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    if os.getpgrp() != os.getpid():
        os.setsid()  # out of reach of the terminal's Ctrl-C, with all that Ray starts

    def say(**message):
        out.write(json.dumps(message) + "\n")
        out.flush()

    events = queue.SimpleQueue()
    catch_signals(events)
    try:
        drive(lines, events, say)
    except Failure as e:
        say(message_type="error", kind=e.kind, text=str(e))
        return 1
    except BrokenPipeError:  # whoever listened is gone
        return 1
    except Exception as e:
        say(message_type="error", kind="driver", text=f"{type(e).__name__}: {e}"[:2000])
        return 1
    return 0


if __name__ == "__main__":
    # what a daemon thread or a library still does has no say in how this ends
    status = main()
    sys.stderr.flush()
    os._exit(status)
