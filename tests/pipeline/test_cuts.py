"""What is said of cuts names the longest shot as action.yaml wants it."""

import numpy as np

from imocap_core.adapters.tracked_people import advice

FRAMES = np.arange(10, 100)


def test_nothing_is_said_of_one_shot() -> None:
    assert advice([], FRAMES) == ""


def test_the_longest_shot_is_advised() -> None:
    assert "frame 40: " in advice([40], FRAMES)
    assert "`frames: [40, 100]`" in advice([40], FRAMES)
    assert "frames 20, 60: " in advice([20, 60], FRAMES)
    assert "`frames: [20, 60]`" in advice([20, 60], FRAMES)
