"""A Dask cluster of this machine whose workers have working folders."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from imocap_core.pipeline.graph import VARIABLE
from imocap_core.pipeline.source import PROJECT

PATIENCE_S = 120


@dataclass
class StartedCluster:
    """A scheduler's address, and the processes of its workers."""

    address: str
    workers: list[subprocess.Popen[bytes]] = field(default_factory=list)


def ended(process: subprocess.Popen[bytes]) -> None:
    """End a process, one that does not heed it too."""
    process.terminate()
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@contextmanager
def started_cluster(
    roots: Sequence[Path], environment: Mapping[str, str], *, replaced: bool = True
) -> Iterator[StartedCluster]:
    """A scheduler, and a worker of one thread in each of these working folders, all ready.

    Args:
        environment: further variables of all processes.
        replaced: a worker that dies is started again (by Dask's nanny).
    """
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    with ExitStack() as stack:

        def start(module: str, *words: str, **more: str) -> subprocess.Popen[bytes]:
            process = subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{module}", *words, "--no-dashboard"],
                env={**os.environ, **environment, **more},
                cwd=PROJECT,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            stack.callback(ended, process)
            return process

        start("dask_scheduler", "--host", "127.0.0.1", "--port", str(port))
        cluster = StartedCluster(f"127.0.0.1:{port}")
        for root in roots:
            words = [cluster.address, "--nthreads", "1", "--local-directory", str(root / "dask")]
            words += [] if replaced else ["--no-nanny"]
            settings = {VARIABLE: str(root)}
            settings["DASK_DISTRIBUTED__WORKER__DAEMON"] = "False"
            cluster.workers.append(start("dask_worker", *words, **settings))
        _wait_for_workers(cluster.address, len(roots))
        yield cluster


def _wait_for_workers(address: str, count: int) -> None:
    from distributed import Client

    with Client(address, timeout=PATIENCE_S) as client:
        client.wait_for_workers(count, timeout=PATIENCE_S)
