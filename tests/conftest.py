"""Settings shared by the whole suite."""

from collections.abc import Iterator

import jaxtyping
import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

import tests.shape_check  # noqa: F401  (the hook names it)

# Rooms whose annotations (types, and shapes of arrays) are checked at every call in the tests.
CHECKED: tuple[str, ...] = (
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
    "imocap_core.problem",
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

install_import_hook(CHECKED, "tests.shape_check.checked")

# No deadline: the suite must not fail on a busy machine. Derandomised: a failure is the same
# failure on every machine.
settings.register_profile("imocap", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("imocap")


@pytest.fixture
def unchecked_shapes() -> Iterator[None]:
    """Annotations unchecked, for tests of a function's own checks of its arguments."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
