"""Wrong shapes are found in the first calls of a test, and nothing is checked beyond them."""

import jaxtyping
import numpy as np
import pytest

from imocap_core.metrics.position import joint_errors_mm
from tests.shape_check import CALLS, begin_test

FLAT = np.zeros((2, 3))  # no frames


def test_the_first_calls_of_every_test_are_checked() -> None:
    for _ in range(2):
        begin_test()
        for _ in range(CALLS):
            with pytest.raises(jaxtyping.TypeCheckError):
                joint_errors_mm(FLAT, FLAT)
        with pytest.raises(ValueError, match="must both be"):  # its own check
            joint_errors_mm(FLAT, FLAT)
