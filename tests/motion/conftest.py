"""The body and the scene of three views that most tests of the motion share."""

import numpy as np
import pytest

from imocap_core.body import load_free_body
from imocap_core.motion.state import Body
from tests.motion.made import FRAMES, TURNS_DEG, Made, scene


@pytest.fixture(scope="session")
def body() -> Body:
    return Body.of(load_free_body(), "body25")


@pytest.fixture(scope="session")
def made() -> Made:
    return scene(FRAMES, TURNS_DEG, np.random.default_rng(5))
