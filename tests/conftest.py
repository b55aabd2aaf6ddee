"""Settings shared by the whole suite."""

import gc
import os
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jaxtyping
import pytest
from hypothesis import settings

from imocap_core.workers import take_share
from tests.shape_check import begin_test, check_annotations

if TYPE_CHECKING:
    from tests.report.made import Made

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

# Left out by `make test`: whole runs of the pipeline and synchronisations of several videos, killed
# processes, servers, browsers, and the measurements behind the benchmarks. A file's tests stay on
# one worker (Makefile): what takes longest begins first, so that nothing is alone at the end.
LONG = (
    "regression",
    "sync/test_hard_videos.py",
    "sync/test_screening.py",
    "sync/test_rate.py",
    "sync/test_anchors.py",
    "stages/test_walking_camera.py",
    "collect/test_listing.py",
    "cli/test_sync_command.py",
    "executors/test_cluster.py",
    "benchmarks",
    "pick/test_page_in_browser.py",
    "viewer/test_viewer_in_browser.py",
    "compare/test_comparison_in_browser.py",
    "report/test_report_page_in_browser.py",
    "examples",
    "test_film.py",
    "io/test_fuzz.py",
)

ONCE = ("tests/library/", "tests/synthetic/")  # a small run; the clips of a seed

check_annotations(CHECKED)

# No deadline: the suite must not fail on a busy machine. Derandomised: a failure is the same
# failure on every machine.
settings.register_profile("imocap", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("imocap")


@pytest.hookimpl(optionalhook=True)  # without xdist nobody asks
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """A file's tests stay on one worker; so do those of a room that makes something large once."""
    from xdist.scheduler import LoadFileScheduling

    class ByFileOrRoom(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return next((room for room in ONCE if nodeid.startswith(room)), None) or (
                super()._split_scope(nodeid)
            )

    return ByFileOrRoom(config, log)


def pytest_configure() -> None:
    """One core for each of several workers: two threads of a solve would wait for one another."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        take_share(1)


@pytest.hookimpl(tryfirst=True)  # before `-m` chooses
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long tests are marked so and come first, all else as collected."""
    places = [Path(__file__).parent / name for name in LONG]
    rank = {
        path: next((n for n, place in enumerate(places) if path.is_relative_to(place)), None)
        for path in {item.path for item in items}
    }
    for item in items:
        if rank[item.path] is not None:
            item.add_marker(pytest.mark.long)
    items.sort(key=lambda item: len(LONG) if (n := rank[item.path]) is None else n)
    gc.collect()
    gc.freeze()  # modules and collected tests live to the end: the collector need not search them
    gc.set_threshold(50_000, 20, 50)  # nor, often, what modules keep in caches


def pytest_runtest_setup() -> None:
    """Annotations are checked at the first calls of each test."""
    begin_test()


@pytest.fixture(scope="session")
def made() -> "Made":
    """Three videos of one waving body, as artifacts; making them costs more than looking."""
    from tests.report.made import Made

    return Made()


@pytest.fixture(scope="session", autouse=True)
def ground_once() -> Iterator[None]:
    """The ground under the made motions, half a second, is not estimated at each reading."""
    from imocap_core.result import video_motion

    estimate, known = video_motion.estimate_ground, dict[bytes, Any]()

    def remembered(*arguments: Any) -> Any:
        key = pickle.dumps(arguments)
        if key not in known:
            known[key] = estimate(*arguments)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(video_motion, "estimate_ground", remembered)
        yield


@pytest.fixture(scope="session", autouse=True)
def no_words_of_pytest() -> Iterator[None]:
    """The command line reads the words of its process, too: here there are none."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", ["imocap"])
        yield


@pytest.fixture
def unchecked_shapes() -> Iterator[None]:
    """Annotations unchecked, for tests of a function's own checks of its arguments."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
