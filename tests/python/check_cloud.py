"""Batches from buckets and into buckets, with a server that speaks S3 on this machine (moto).

    check_cloud.py PROGRAM TESTS FOLDER

PROGRAM and TESTS (tests/cloud.rs) are built with the feature `cloud`. TESTS also run on a server that speaks Azure's protocol (Azurite, from npm)
if there is npm. The last line says how many checks passed and failed.
"""

import base64
import hashlib
import hmac
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from email.utils import formatdate
from pathlib import Path

import boto3

import check_batch
import make_takes
from check_batch import check, differences, tree

BUCKET = "studio"
AZURITE = "3.37.0"


def free_port():
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return listening.getsockname()[1]


def start_server(folder):
    """A server on a port of its own, and the environment to find it with."""
    port = free_port()
    endpoint = f"http://127.0.0.1:{port}"
    log = open(folder / "server.log", "wb")
    server = subprocess.Popen([sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)], stdout=log, stderr=log)
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("AWS_", "GOOGLE_", "AZURE_"))}
    (folder / "tmp").mkdir()
    environment.update(TMPDIR=str(folder / "tmp"), AWS_ACCESS_KEY_ID="key", AWS_SECRET_ACCESS_KEY="secret", AWS_REGION="us-east-1", AWS_ENDPOINT_URL=endpoint, AWS_ALLOW_HTTP="true")
    client = boto3.client("s3", endpoint_url=endpoint, aws_access_key_id="key", aws_secret_access_key="secret", region_name="us-east-1")
    for _ in range(300):
        try:
            client.create_bucket(Bucket=BUCKET)
            return server, environment, client
        except Exception:  # noqa: BLE001 (whatever it is, it is not there yet)
            time.sleep(0.2)
    raise SystemExit(f"the server does not answer: {(folder / 'server.log').read_text()[-1000:]}")


def objects(client, prefix):
    """All objects below a prefix by name, without what is kept about running."""
    found = {}
    for page in client.get_paginator("list_objects_v2").paginate(Bucket=BUCKET, Prefix=prefix + "/"):
        for entry in page.get("Contents", []):
            name = entry["Key"][len(prefix) + 1 :]
            if not name.startswith(check_batch.OWN + "/"):
                found[name] = client.get_object(Bucket=BUCKET, Key=entry["Key"])["Body"].read()
    return found


def repaired(found):
    """Without sidecars, which say of an input in a bucket what the bucket calls its version."""
    return {name: content for name, content in found.items() if not name.endswith(".repair.json")}


def start_azurite(folder):
    """The same for Azure; None without npm."""
    if not shutil.which("npm"):
        return None
    place = folder / "azurite"
    place.mkdir()
    words = ["npm", "install", "--prefix", place, "--ignore-scripts", "--no-audit", "--no-fund", "--silent", f"azurite@{AZURITE}"]
    subprocess.run(words, check=True, stdin=subprocess.DEVNULL)
    port = free_port()
    words = ["node", place / "node_modules" / ".bin" / "azurite-blob", "--silent", "--skipApiVersionCheck", "--disableTelemetry"]
    log = open(folder / "azurite.log", "wb")
    server = subprocess.Popen([*words, "--location", place, "--blobHost", "127.0.0.1", "--blobPort", str(port)], stdout=log, stderr=log)
    for _ in range(300):
        with socket.socket() as asking:
            if asking.connect_ex(("127.0.0.1", port)) == 0:
                break
        time.sleep(0.1)
    # the account and the key that every such server has
    key = "Eby8vdM02xNOcqFlqUwJPLlmEtlCDXJ1OUzFT50uSRZ6IFsuFq2UVErCz4I6tq/K1SZFPTOtr/KBHBeksoGMGw=="
    environment = dict(AZURE_STORAGE_ACCOUNT_NAME="devstoreaccount1", AZURE_STORAGE_ACCOUNT_KEY=key, AZURE_ALLOW_HTTP="true")
    environment.update(AZURE_STORAGE_ENDPOINT=f"http://127.0.0.1:{port}/devstoreaccount1", MOCAP_TEST_AZ="az://takes/in a/100%")
    make_container(port, key)
    return server, environment


def make_container(port, key):
    """What nobody who only reads and writes objects can do: PUT /devstoreaccount1/takes?restype=container, signed."""
    date = formatdate(usegmt=True)
    headers = f"x-ms-date:{date}\nx-ms-version:2021-08-06\n"
    # the account is there twice: the server has it in its path
    text = f"PUT\n\n\n\n\n\n\n\n\n\n\n\n{headers}/devstoreaccount1/devstoreaccount1/takes\nrestype:container"
    signature = base64.b64encode(hmac.new(base64.b64decode(key), text.encode(), hashlib.sha256).digest()).decode()
    request = urllib.request.Request(f"http://127.0.0.1:{port}/devstoreaccount1/takes?restype=container", method="PUT")
    for name, value in [("x-ms-date", date), ("x-ms-version", "2021-08-06"), ("Content-Length", "0"),
                        ("Authorization", f"SharedKey devstoreaccount1:{signature}")]:
        request.add_header(name, value)
    urllib.request.urlopen(request).close()


def places(tests, environment, azure):
    """tests/cloud.rs, on whatever there is."""
    environment = dict(environment, MOCAP_TEST_S3=f"s3://{BUCKET}/in a/100%", **azure)
    done = subprocess.run([tests], capture_output=True, text=True, env=environment, timeout=900)
    print(done.stdout)
    counted = re.search(r"test result: \w+\. (\d+) passed; (\d+) failed", done.stdout)
    check("tests of places ran", counted is not None, done.stderr[-1000:])
    if counted:
        check_batch.passed += int(counted[1])
        check_batch.failed += int(counted[2])


def main(program, tests, folder):
    program, folder = Path(program).resolve(), Path(folder).resolve()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    server, environment, client = start_server(folder)
    servers = [server]
    try:
        azure = start_azurite(folder)
        if azure:
            servers.append(azure[0])
        places(tests, environment, azure[1] if azure else {})
        batches(program, folder, environment, client)
    finally:
        for server in servers:
            server.terminate()
            server.wait()
    shutil.rmtree(folder, ignore_errors=True)
    print(f"{check_batch.passed} passed, {check_batch.failed} failed")
    return 1 if check_batch.failed else 0


def batches(program, folder, environment, client):
    def batch(*words, code=None, what=""):
        done = subprocess.run([program, "batch", *words], capture_output=True, text=True, env=environment, timeout=600)
        if code is not None:
            check(what or " ".join(map(str, words[:2])), done.returncode == code, (done.returncode, done.stdout[-500:], done.stderr[-800:]))
        return done

    make_takes.main(program, folder / "takes", 50)
    takes = tree(folder / "takes")
    for name, content in takes.items():
        client.put_object(Bucket=BUCKET, Key=f"in/{name}", Body=content)
    # as somebody would have it on a machine
    batch("plan", folder / "takes", "-o", folder / "local.jsonl", code=0, what="takes in a folder are planned")
    batch("run", folder / "local.jsonl", "--out", folder / "local", "--quiet", code=3, what="a folder is repaired into a folder")
    whole = tree(folder / "local")

    batch("plan", f"s3://{BUCKET}/in", "-o", folder / "s3.jsonl", code=0, what="takes in a bucket are planned")
    names = [json.loads(line)["output"] for line in (folder / "s3.jsonl").read_text(encoding="utf-8").splitlines()[1:]]
    there = [json.loads(line)["output"] for line in (folder / "local.jsonl").read_text(encoding="utf-8").splitlines()[1:]]
    check("names are those of a folder", sorted(names) == sorted(there), (names[:3], there[:3]))

    batch("run", folder / "s3.jsonl", "--out", f"s3://{BUCKET}/out", "--quiet", code=3, what="a bucket is repaired into a bucket")
    out = objects(client, "out")
    check("the bucket holds what the folder holds", repaired(out) == repaired(whole), differences(repaired(out), repaired(whole)))
    check("every take has its sidecar", sorted(out) == sorted(whole), differences(out, whole))

    told = batch("run", folder / "s3.jsonl", "--out", f"s3://{BUCKET}/out", "--json", code=3, what="the same command again")
    ended = json.loads(told.stdout.splitlines()[-1])
    check("does nothing twice", (ended["done"], ended["skipped"], ended["quarantined"]) == (0, 45, 5), ended)
    damaged = next(name for name in sorted(out) if name.endswith(".c3d"))
    client.put_object(Bucket=BUCKET, Key=f"out/{damaged}", Body=b"damaged")
    told = batch("run", folder / "s3.jsonl", "--out", f"s3://{BUCKET}/out", "--json", code=3, what="and once more after damage")
    check("mends what was damaged", json.loads(told.stdout.splitlines()[-1])["done"] == 1 and objects(client, "out") == out, told.stdout[-300:])
    status = batch("status", f"s3://{BUCKET}/out", "--json", code=3, what="status of a bucket")
    status = json.loads(status.stdout.splitlines()[-1])
    check("accounts for every take", (status["takes"], status["done"], status["quarantined"], status["open"]) == (50, 45, 5, 0), status)

    batch("run", folder / "local.jsonl", "--out", f"s3://{BUCKET}/from-folder", "--quiet", code=3, what="a folder is repaired into a bucket")
    check("with the same bytes", objects(client, "from-folder") == whole, differences(objects(client, "from-folder"), whole))
    batch("run", folder / "s3.jsonl", "--out", folder / "from-s3", "--quiet", code=3, what="a bucket is repaired into a folder")
    check("with the same bytes as in the bucket", tree(folder / "from-s3") == out, differences(tree(folder / "from-s3"), out))

    ray = ["--engine", "ray", "--jobs", "2", "--python", sys.executable]
    batch("run", folder / "s3.jsonl", "--out", f"s3://{BUCKET}/ray", "--quiet", *ray, code=3, what="Ray repairs a bucket into a bucket")
    check("with the same bytes by Ray", objects(client, "ray") == out, differences(objects(client, "ray"), out))

    def left():
        """Temporary folders of takes."""
        return [path.name for path in Path(environment["TMPDIR"]).glob("mocap-repair-*")]

    hit = 0
    for at in range(3):
        child = subprocess.Popen([program, "batch", "run", folder / "s3.jsonl", "--out", f"s3://{BUCKET}/killed", "--quiet"], env=environment)
        time.sleep(0.5 + 0.7 * at)
        child.send_signal(signal.SIGKILL)
        hit += child.wait() == -signal.SIGKILL
    check("it was killed three times", hit == 3, hit)
    batch("run", folder / "s3.jsonl", "--out", f"s3://{BUCKET}/killed", "--quiet", code=3, what="a batch that was killed three times goes on")
    check("and leaves nothing in temporary folders", not left(), left())
    check("and leaves the same objects", objects(client, "killed") == out, differences(objects(client, "killed"), out))

    client.put_object(Bucket=BUCKET, Key=f"mine/{damaged}", Body=b"mine")
    batch("run", folder / "s3.jsonl", "--out", f"s3://{BUCKET}/mine", "--quiet", code=1, what="a bucket with somebody's object")
    kept = objects(client, "mine")[damaged]
    check("nobody's object is replaced", kept == b"mine", kept[:50])
    told = batch("plan", "s3://nowhere/in", "-o", folder / "no.jsonl", code=1, what="a bucket that is not there is refused")
    check("by its name", "nowhere" in told.stderr, told.stderr)
    environment["AWS_ENDPOINT_URL"] = f"http://127.0.0.1:{free_port()}"
    told = batch("status", f"s3://{BUCKET}/out", what="a server that is not there")
    check("a server that is not there is told, and may be there later", told.returncode == 75, (told.returncode, told.stderr))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
