"""The made scene of the report's tests."""

from __future__ import annotations

import pytest

from tests.report.made import Made


@pytest.fixture(scope="session")
def made() -> Made:
    """Three videos of one waving body."""
    return Made()
