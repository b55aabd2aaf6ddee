"""Names of actions that a benchmark has both from keypoints and as rendered videos."""

from __future__ import annotations

from pathlib import Path

from imocap_core.detect.detection import is_set_up
from imocap_core.detect.detectors import detector_of
from imocap_core.errors import WorkFailed
from imocap_core.params import DetectParams

RENDERED = "-rendered"


def is_rendered(name: str) -> bool:
    """Whether an action is its trial put on the free body, rendered and detected."""
    return name.endswith(RENDERED)


def trial_of(name: str) -> str:
    """The name of an action in trials."""
    return name.removesuffix(RENDERED)


def check_detector(root: Path) -> None:
    """WorkFailed when the default detector's environment is not here."""
    if not is_set_up(detector_of(DetectParams(), root)):
        raise WorkFailed("the detector's environment is not installed (`imocap detect --setup`)")
