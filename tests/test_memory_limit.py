"""Sizes of memory as people write them."""

from __future__ import annotations

import pytest

from imocap_core.errors import WrongUse
from imocap_core.process import memory_size


@pytest.mark.parametrize(
    ("text", "size"),
    [("4G", 4 << 30), ("1500M", 1500 << 20), ("2.5GiB", 5 << 29), ("1gb", 1 << 30)],
)
def test_sizes_are_powers_of_1024(text: str, size: int) -> None:
    assert memory_size(text) == size


@pytest.mark.parametrize("text", ["", "G", "4X", "-4G", "1e9", "100M", "4"])
def test_what_is_none_or_too_small_is_refused(text: str) -> None:
    with pytest.raises(WrongUse, match=r"memory"):
        memory_size(text)
