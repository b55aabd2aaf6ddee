"""Stages compute with one thread whatever the environment says."""

import json
import os
import subprocess
import sys

import pytest

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
