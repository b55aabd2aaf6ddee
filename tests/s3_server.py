"""A server that speaks S3, where it is installed: `pip install s3fs 'moto[server]'`."""

import importlib.util
import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from imocap_core.artifacts.shared_store import shared_files

HAS_S3 = all(importlib.util.find_spec(name) for name in ("s3fs", "moto", "flask"))
needs_s3 = pytest.mark.skipif(not HAS_S3, reason="needs s3fs and moto's server")
BUCKET = "lab"


@contextmanager
def environment(values: dict[str, str]) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def free_port() -> int:
    """A port at which nobody answers."""
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        return int(unused.getsockname()[1])


@contextmanager
def s3_server(**settings: str) -> Iterator[int]:
    """The port of a server without buckets."""
    port = free_port()
    process = subprocess.Popen(
        [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
        env={**os.environ, **settings},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        for _ in range(200):
            try:
                urllib.request.urlopen(f"http://127.0.0.1:{port}/moto-api/").close()
                break
            except OSError:
                time.sleep(0.1)
        yield port
    finally:
        process.terminate()
        process.wait()


@contextmanager
def reaching(port: int, *, keys: bool = True) -> Iterator[None]:
    """Processes of the body use the server at a port."""
    import s3fs

    values = {"AWS_DEFAULT_REGION": "us-east-1", "AWS_ENDPOINT_URL": f"http://127.0.0.1:{port}"}
    if keys:
        values |= {"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b"}
    with environment(values):
        s3fs.S3FileSystem.clear_instance_cache()
        shared_files.cache_clear()
        yield


@contextmanager
def s3_store(folder: Path) -> Iterator[str]:
    """The URL of an empty store in a bucket."""
    import s3fs

    with s3_server() as port, reaching(port):
        s3fs.S3FileSystem().mkdir(BUCKET)
        yield f"s3://{BUCKET}/{folder.name}"
