"""Stages compute with one thread whatever the environment says."""

import json
import os
import subprocess
import sys

import pytest

from imocap_core.errors import WrongUse
from imocap_core.process import memory_size

PROGRAM = """
import json
from threadpoolctl import threadpool_info
from imocap_core.process import configure_process
before = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
configure_process()
import cv2
import torch
after = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
print(json.dumps([before, after, torch.get_num_threads(), cv2.getNumThreads()]))
"""


@pytest.mark.long
def test_linear_algebra_has_one_thread_where_a_run_begins() -> None:
    environment = {**os.environ, "OMP_NUM_THREADS": "3", "OPENBLAS_NUM_THREADS": "3"}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    )
    before, after, of_torch, of_opencv = json.loads(done.stdout)
    assert after
    assert set(after) == {1}
    assert of_torch == of_opencv == 1
    assert all(count == 3 for count in before)


@pytest.mark.parametrize(
    ("text", "size"),
    [("4G", 4 << 30), ("1500M", 1500 << 20), ("2.5GiB", 5 << 29), ("1gb", 1 << 30)],
)
def test_sizes_are_powers_of_1024(text: str, size: int) -> None:
    assert memory_size(text) == size


@pytest.mark.parametrize("text", ["", "G", "4X", "-4G", "1e9", "100M", "4"])
def test_what_is_none_or_too_small_is_refused(text: str) -> None:
    with pytest.raises(WrongUse, match=r"memory"):
        memory_size(text)
