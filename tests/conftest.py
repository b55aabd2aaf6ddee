"""Settings shared by the whole suite."""

import gc
from collections.abc import Iterator
from pathlib import Path

import jaxtyping
import pytest
from hypothesis import settings

from tests.shape_check import begin_test, check_annotations

# Rooms whose annotations (types, and shapes of arrays) are checked in the tests.
CHECKED: tuple[str, ...] = (
    "benchmarks.synthetic",
    "imocap_core.alignment",
    "imocap_core.body",
    "imocap_core.camera",
    "imocap_core.collect",
    "imocap_core.compare",
    "imocap_core.detect",
    "imocap_core.evaluate",
    "imocap_core.export",
    "imocap_core.figures",
    "imocap_core.film",
    "imocap_core.hands",
    "imocap_core.io",
    "imocap_core.library",
    "imocap_core.lifter",
    "imocap_core.metrics",
    "imocap_core.motion",
    "imocap_core.people",
    "imocap_core.pick",
    "imocap_core.adapters",
    "imocap_core.render",
    "imocap_core.rotations",
    "imocap_core.report",
    "imocap_core.result",
    "imocap_core.standalone_sync",
    "imocap_core.sync",
    "imocap_core.synthetic",
    "imocap_core.technique",
    "imocap_core.viewer",
    "imocap_core.workspace",
)

# A file's tests stay on one worker (Makefile): the files that take longest begin first, so that
# none of them is alone at the end.
LONGEST = (
    "sync/test_playback_rate.py",
    "chaos/test_threads_and_order.py",
    "sync/test_anchors.py",
    "regression/test_yoga.py",
    "regression/test_balance_beam.py",
    "sync/test_screening.py",
    "cli/test_sync_command.py",
    "sync/test_hard_videos.py",
)

check_annotations(CHECKED)

# No deadline: the suite must not fail on a busy machine. Derandomised: a failure is the same
# failure on every machine.
settings.register_profile("imocap", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("imocap")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first, all else as collected."""
    folder = Path(__file__).parent
    rank = {folder / name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path, len(rank)))
    gc.collect()
    gc.freeze()  # modules and collected tests live to the end: the collector need not search them
    gc.set_threshold(50_000, 20, 50)  # nor, often, what modules keep in caches


def pytest_runtest_setup() -> None:
    """Annotations are checked at the first calls of each test."""
    begin_test()


@pytest.fixture
def unchecked_shapes() -> Iterator[None]:
    """Annotations unchecked, for tests of a function's own checks of its arguments."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
