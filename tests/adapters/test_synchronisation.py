"""The stage's own part: from artifacts to the core and back, and what is stored of soft maps."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from imocap_core.adapters.sync_maps import LEFT_OUT, affinity_between, maps_of
from imocap_core.adapters.synchronisation import evidence_of, synchronise_motions
from imocap_core.artifacts.schemas import Keypoints, Sync, SyncMap
from imocap_core.body.layouts import layout_names
from imocap_core.conventions import SMPL_JOINTS
from tests.made_keypoints import made_keypoints
from tests.made_sync import stored_matrix
from tests.sync.made_motions import view_of
from tests.sync.test_synchronise import PARAMS as SYNC_PARAMS
from tests.sync.test_synchronise import pose_at

PARAMS = replace(SYNC_PARAMS, max_rate=20.0, consensus_rounds=1)


def made(ids: list[str], offsets_s: list[float]) -> tuple[list[np.ndarray], Keypoints]:
    """Videos of one motion at 25 frames/s, each starting later; 24 joints from 12."""
    T = 60
    motions, detections = [], []
    for name, offset in zip(ids, offsets_s, strict=True):
        pose = pose_at(offset + np.arange(T) / 25.0)
        joints = np.concatenate([pose, 0.9 * pose[:, ::-1]], axis=1)
        joints += 0.01 * np.random.default_rng(3).normal(size=joints.shape)
        motions.append(joints)
        detections.append(
            made_keypoints(
                np.arange(T), id=name, fps=25.0, size=(64, 48), confidence=np.ones((T, 25))
            )
        )
    return motions, Keypoints(videos=detections)


def synchronised(
    joints: list[np.ndarray], keypoints: Keypoints, reference: str | None = None
) -> Sync:
    evidence, rng = evidence_of(joints, keypoints), np.random.default_rng(0)
    return synchronise_motions(evidence, keypoints, PARAMS, rng, reference=reference)


def test_maps_are_named_and_lie_where_they_should() -> None:
    joints, keypoints = made(["a", "b"], [0.0, 0.4])
    sync = synchronised(joints, keypoints, "a")
    assert sync.reference == "a"
    assert [m.id for m in sync.maps] == ["a", "b"]
    frames = sync.maps[1].reference_frame
    matched = np.isfinite(frames)
    assert np.median(np.abs(frames - np.arange(60) - 10)[matched]) < 0.5
    assert affinity_between(sync, *sync.ids[:2])[0].shape == tuple(sync.lengths[:2])


def test_a_frame_without_detections_does_not_count() -> None:
    joints, keypoints = made(["a", "b"], [0.0, 0.4])
    joints[1][20:24] = np.random.default_rng(1).normal(size=(4, 24, 3))
    keypoints.videos[1].confidence[20:24] = 0.0
    sync = synchronised(joints, keypoints, "a")
    frames = sync.maps[1].reference_frame[18:26]
    assert np.abs(frames - np.arange(28, 36)).max() < 1.5


def test_one_video_is_its_own_reference() -> None:
    joints, keypoints = made(["only"], [0.0])
    sync = synchronised(joints, keypoints)
    np.testing.assert_array_equal(sync.maps[0].reference_frame, np.arange(60.0))
    assert "nothing to synchronise" in sync.status


def test_unknown_reference_is_refused() -> None:
    joints, keypoints = made(["a"], [0.0])
    with pytest.raises(ValueError, match="z"):
        synchronised(joints, keypoints, "z")


def test_what_two_videos_show_beyond_the_reference_they_are_sure_of() -> None:
    """The second ends 10 frames after the reference, the third 20."""
    joints, keypoints = made(["a", "b", "c"], [0.0, 0.4, 0.8])
    sync = synchronised(joints, keypoints, "a")
    a, b, c = (video.phase_confidence for video in sync.trust.videos)
    assert b[51:58].min() > 0.3
    assert c[41:48].min() > 0.3
    assert c[53:].max() == 0  # nobody else shows that
    assert a[:8].max() == 0


def test_trust_and_phase_travel_with_the_artifact() -> None:
    joints, keypoints = made(["a", "b", "c"], [0.0, 0.4, 0.8])
    films = filmed(keypoints, joints, [0.0, 1.3, 2.6])
    sync = synchronised(joints, films, "a")
    assert [v.id for v in sync.trust.videos] == ["a", "b", "c"]
    for video, offset in zip(sync.trust.videos, [0.0, 0.4, 0.8], strict=True):
        off = np.abs(video.phase_s - offset - np.arange(60) / 25.0)
        assert off[: 55 - round(25 * offset)].max() < 0.1
        assert off.max() < 0.4  # beyond the reference's end others and an even pace carry it
    (triple,) = sync.trust.triples
    assert triple.videos == ["a", "b", "c"]
    assert triple.frames < 1.5
    assert abs(triple.seconds - triple.frames / 25.0) < 1e-12
    assert sync.notes == []


def filmed(keypoints: Keypoints, joints: list[np.ndarray], azimuths: list[float]) -> Keypoints:
    """The keypoints of motions seen from several sides, far enough for a scaled projection."""
    videos = []
    for video, xyz, azimuth in zip(keypoints.videos, joints, azimuths, strict=True):
        turned = view_of(xyz, azimuth)
        xy = np.full((*video.confidence.shape, 2), np.nan)
        for column, name in enumerate(layout_names(video.layout)):
            if name in SMPL_JOINTS:
                joint = turned[:, SMPL_JOINTS.index(name)]
                xy[:, column] = 300 * joint[:, :2] / (joint[:, 2:] + 20.0) + 30
        weight = np.isfinite(xy).all(-1).astype(float)
        videos.append(video.model_copy(update={"xy_px": xy, "confidence": weight}))
    return Keypoints(videos=videos)


@pytest.mark.long
def test_keypoints_that_the_others_explain_keep_a_video_in() -> None:
    """Its monocular poses went wrong, as those of another action; its pictures did not."""
    ids, sides = ["a", "b", "c", "d"], [0.0, 1.3, 2.6, 4.0]
    right, keypoints = made(ids, [0.0, 0.4, 0.8, 0.2])
    wrong, _ = made(ids, [0.0, 0.4, 0.8, 60.0])
    sync = synchronised(wrong, filmed(keypoints, right, sides))
    assert sync.excluded == []
    stranger = synchronised(wrong, filmed(keypoints, wrong, sides))
    assert stranger.excluded == ["d"]


def test_an_excluded_video_is_named_and_unmatched() -> None:
    joints, keypoints = made(["a", "b", "c", "d"], [0.0, 0.4, 0.8, 60.0])
    films = filmed(keypoints, joints, [0.0, 1.3, 2.6, 4.0])
    sync = synchronised(joints, films)
    assert sync.excluded == ["d"]
    assert np.isnan(sync.maps[3].reference_frame).all()
    assert sync.notes[0].startswith("d seems to show another action")


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
