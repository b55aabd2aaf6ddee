"""All that a detector needs before it runs: its environment and its networks' files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from imocap_core.artifacts.lock import exclusive
from imocap_core.detect.detectors import Detector
from imocap_core.detect.environment import FOLDER, environment_folder, is_available, python_for
from imocap_core.detect.network_files import fetch_networks, is_present


def set_up(detector: Detector, announce: Callable[[str], None]) -> Path:
    """The Python that the detector runs in; what is missing is made or fetched, and `announce` is
    called before each slow step. WorkFailed when that fails.

    Of several processes one makes it, and the others wait.
    """
    if is_set_up(detector):
        return _complete(detector, announce)
    lock = environment_folder().with_name(f"{FOLDER}.lock")
    with exclusive(lock, lambda: announce("another process makes the detector's environment")):
        return _complete(detector, announce)


def _complete(detector: Detector, announce: Callable[[str], None]) -> Path:
    python = python_for(detector.packages, announce)
    fetch_networks(list(detector.networks.values()), announce)
    return python


def is_set_up(detector: Detector) -> bool:
    """Whether `set_up` would make and fetch nothing."""
    return is_available(detector.packages) and all(map(is_present, detector.networks.values()))
