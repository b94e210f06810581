"""A server of an S3 object store on this machine, moto's, that asks for credentials; and a way to it that is cut.

Needs an environment with moto[server] and boto3, such as .tools/s3.
"""

import contextlib
import json
import os
import socket
import subprocess
import threading
import time
import urllib.request
from pathlib import Path

from slurm_node import free_ports

STARTS_S = 120
REGION = {"AWS_DEFAULT_REGION": "us-east-1"}
BUCKET = "bucket"
EVERYTHING = json.dumps(
    {"Version": "2012-10-17", "Statement": [{"Effect": "Allow", "Action": "s3:*", "Resource": "*"}]}
)
UNCHECKED = 4  # requests that set the server up: bucket, user, policy, key; each one after them needs credentials


@contextlib.contextmanager
def serving(python, folder):
    """Start moto's server with an empty bucket; give (its address, the environment with credentials that it takes).

    python  of the environment that has moto; folder for the server's log
    """
    (port,) = free_ports(1)
    address = f"http://127.0.0.1:{port}"
    environment = os.environ | {"INITIAL_NO_AUTH_ACTION_COUNT": str(UNCHECKED)}
    with open(Path(folder) / "server.log", "w") as log:
        server = subprocess.Popen(
            [python, "-m", "moto.server", "-p", str(port)], env=environment, stdout=log, stderr=log
        )
    try:
        wait_for(address, server)
        said = subprocess.run(
            [python, __file__, address], env=os.environ | REGION | credentials("setup", "setup"),
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        yield address, os.environ | REGION | credentials(*said.stdout.split())
    finally:
        server.terminate()
        server.wait()


def credentials(key, secret):
    """Return the environment's variables of an access key."""
    return {"AWS_ACCESS_KEY_ID": key, "AWS_SECRET_ACCESS_KEY": secret}


def wait_for(address, server):
    """Wait until a server answers; raise RuntimeError where it has ended or stays silent."""
    end = time.monotonic() + STARTS_S
    while server.poll() is None and time.monotonic() < end:
        with contextlib.suppress(OSError):
            urllib.request.urlopen(f"{address}/moto-api/data.json", timeout=5).close()
            return
        time.sleep(0.3)
    raise RuntimeError(f"{address}: moto's server did not start")


@contextlib.contextmanager
def cut_after(address, most_bytes):
    """Give the address of a way to a server on which each connection is cut after so many bytes of answer."""
    host, port = address.removeprefix("http://").split(":")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=_accept, args=(listener, (host, int(port)), most_bytes), daemon=True).start()
        yield f"http://127.0.0.1:{listener.getsockname()[1]}"


def _accept(listener, server, most_bytes):
    with contextlib.suppress(OSError):
        while True:
            client, _ = listener.accept()
            answers = socket.create_connection(server)
            threading.Thread(target=_pass_on, args=(client, answers, None), daemon=True).start()
            threading.Thread(target=_pass_on, args=(answers, client, most_bytes), daemon=True).start()


def _pass_on(source, sink, most_bytes):
    passed = 0
    with contextlib.suppress(OSError):
        while data := source.recv(1 << 16):
            passed += len(data)
            if most_bytes is not None and passed > most_bytes:
                break
            sink.sendall(data)
    for end in (source, sink):
        with contextlib.suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)
        end.close()


def set_up(address):
    """Make the bucket and a user who may use it; return (access key, secret)."""
    import boto3

    boto3.client("s3", endpoint_url=address).create_bucket(Bucket=BUCKET)
    iam = boto3.client("iam", endpoint_url=address)
    iam.create_user(UserName="twingap")
    iam.put_user_policy(UserName="twingap", PolicyName="all", PolicyDocument=EVERYTHING)
    key = iam.create_access_key(UserName="twingap")["AccessKey"]
    return key["AccessKeyId"], key["SecretAccessKey"]


if __name__ == "__main__":
    import sys

    print(*set_up(sys.argv[1]))
