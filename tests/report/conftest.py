"""A made scene, shared: making it costs more than looking at it."""

import pytest

from tests.report.made import Made


@pytest.fixture(scope="session")
def made() -> Made:
    return Made()
