"""The report repeats what a video's note says beyond who was followed."""

import pytest

from imocap_core.artifacts.schemas import VideoKeypoints
from imocap_core.diagnostics.detection_findings import remarks

FOLLOWED = "2 people followed; the performer is seen in 9 of 9 frames and scores 3.0 times the next"


@pytest.mark.parametrize(
    ("note", "expected"),
    [
        ("", []),
        ("; a new shot begins with frame 4: use one", ["a new shot begins with frame 4: use one"]),
        (
            "; track 2 was taken, not track 1: so; left and right of a limb put back in 3 frames",
            ["track 2 was taken, not track 1: so", "left and right of a limb put back in 3 frames"],
        ),
    ],
)
def test_remarks(note: str, expected: list[str]) -> None:
    assert remarks(VideoKeypoints.model_construct(note=FOLLOWED + note)) == expected
