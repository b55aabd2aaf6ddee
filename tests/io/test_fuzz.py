"""Damaged files are read or refused in a sentence that names them; longer: `make fuzz`."""

import warnings

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tools.fuzz.readers import READERS
from tools.fuzz.run import one


@pytest.mark.parametrize("name", READERS)
@settings(max_examples=8)
@given(seed=st.integers(0, 2**32))
def test_a_damaged_file_is_read_or_refused_in_a_sentence(name: str, seed: int) -> None:
    with warnings.catch_warnings(action="ignore"):  # of odd numbers, which are missing points then
        assert one(name, seed, None) in ("read", "refused")
