"""Small artifacts to write and read back."""

import numpy as np
import pytest

from imocap_core.artifacts.schemas import Sync, SyncMap
from tests.made_sync import stored_matrix


@pytest.fixture
def sync() -> Sync:
    """Two videos of three and two frames, one frame unmatched."""
    maps = [
        SyncMap(id="a", reference_frame=np.arange(3.0), confidence=np.ones(3)),
        SyncMap(id="b", reference_frame=np.array([0.5, np.nan]), confidence=np.array([0.9, 0.0])),
    ]
    return Sync(
        reference="a", ids=["a", "b"], lengths=[3, 2], maps=maps, method="softmap",
        centrality=np.array([1.0, float("inf")]), status="1 frame of b is unmatched",
        **stored_matrix(np.full((5, 5), 0.25), ["a", "b"], [3, 2]),
    )  # fmt: skip
