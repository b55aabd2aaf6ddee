"""What is stored of affinities and soft maps."""

import numpy as np
import pytest
from pydantic import ValidationError

from imocap_core.adapters.sync_maps import LEFT_OUT, affinity_between, maps_of
from imocap_core.artifacts.schemas import Sync, SyncMap
from tests.made_sync import stored_matrix

IDS, LENGTHS = ["a", "b", "c"], [70, 40, 33]
PHASE = np.concatenate([np.linspace(0, 1, n) for n in LENGTHS])
MATRIX = np.exp(-0.5 * ((PHASE[:, None] - PHASE) / 0.02) ** 2)


@pytest.fixture
def sync() -> Sync:
    return Sync(
        reference="a",
        ids=IDS,
        lengths=LENGTHS,
        maps=[
            SyncMap(id=i, reference_frame=np.zeros(n), confidence=np.ones(n))
            for i, n in zip(IDS, LENGTHS, strict=True)
        ],
        method="softmap",
        centrality=np.ones(3),
        status="",
        **stored_matrix(MATRIX, IDS, LENGTHS),
    )


def test_a_stored_map_is_the_map_but_for_what_is_negligible(sync: Sync) -> None:
    maps = maps_of(sync)
    for (i, j), soft_map in maps.pairs.items():
        whole = np.asarray(maps.blocks.block(MATRIX, i, j))
        np.testing.assert_allclose(soft_map.dense(), whole, atol=LEFT_OUT)
        largest = whole[np.arange(len(whole)), soft_map.largest()]
        np.testing.assert_allclose(largest, whole.max(axis=1), atol=1e-6)
    assert sync.relaxed.entries.size < 0.8 * (MATRIX.size - sum(n**2 for n in LENGTHS))


def test_affinities_are_read_in_both_directions(sync: Sync) -> None:
    there, every = affinity_between(sync, "a", "c")
    back, _ = affinity_between(sync, "c", "a")
    np.testing.assert_array_equal(there, back.T)
    np.testing.assert_allclose(there, MATRIX[:70, 110:], atol=1e-5)
    assert every == (1, 1)
    out = sync.model_copy(update={"affinity": []})
    assert not affinity_between(out, "a", "b")[0].any()


def test_bands_that_do_not_fit_the_videos_are_refused(sync: Sync) -> None:
    fields = {name: getattr(sync, name) for name in type(sync).model_fields}
    stored = sync.relaxed
    for update, message in (
        ({"position": stored.position[1:], "width": stored.width[1:]}, "expected .* bands"),
        ({"entries": stored.entries[1:]}, "entries"),
        ({"position": stored.position + 40}, "beyond"),
    ):
        with pytest.raises(ValidationError, match=message):
            Sync(**{**fields, "relaxed": stored.model_copy(update=update)})
