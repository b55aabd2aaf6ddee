"""One run of each action for the whole suite, however many workers share it."""

from pathlib import Path

import pytest

from tests.regression.comparison import BASELINE, Baseline, parse
from tests.regression.measure import DATA_VARIABLE, MADE, REAL, Scored, real_data, run_pipeline


@pytest.fixture(scope="session")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder that all workers of this run share, and no other run.

    A worker's own base folder lies in the one that belongs to the whole run. The tests of one
    action lie in one file, which `--dist loadfile` gives to one worker; with another distribution
    the store's lock still lets one worker run the action while the others wait and find it cached.
    """
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if base.name.startswith("popen-") else base
    folder = shared / "pipeline"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def yoga(root: Path) -> Scored:
    """The project's own demo, from making it to its scores."""
    return run_pipeline(root, MADE)


@pytest.fixture(scope="session")
def balance_beam(root: Path) -> Scored:
    """Real videos."""
    folder = real_data()
    if folder is None:
        pytest.skip(f"{REAL} is not on this machine: {DATA_VARIABLE} names the folder that has it")
    return run_pipeline(root, folder)


@pytest.fixture(scope="session")
def baseline() -> Baseline:
    return parse(BASELINE.read_text(encoding="utf-8"))
