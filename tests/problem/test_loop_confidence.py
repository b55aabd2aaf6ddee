"""Where performances differ, the loop is no surer of a match than the monocular motions were."""

import numpy as np
import pytest

from imocap_core.adapters.joint import is_one_motion
from imocap_core.adapters.loop_sync import with_first_repetitions, with_independent_confidence
from imocap_core.artifacts.schemas import Sync, SyncMap, SyncTrust, VideoTrust
from imocap_core.motion.multiview.scene import DeviationSpread
from tests.made_sync import stored_matrix


def spread(deviation_m: float, path_m: float) -> DeviationSpread:
    return DeviationSpread(np.full((2, 4, 3), deviation_m), np.full((2, 6), path_m))


def sync(frames: list[float], confidence: list[float]) -> Sync:
    identity = SyncMap(id="a", reference_frame=np.arange(4.0), confidence=np.ones(4))
    other = SyncMap(id="b", reference_frame=np.array(frames), confidence=np.array(confidence))
    return Sync(
        reference="a",
        ids=["a", "b"],
        lengths=[4, 4],
        maps=[identity, other],
        method="softmap",
        centrality=np.ones(2),
        status="made",
        **stored_matrix(np.eye(8), ["a", "b"], [4, 4]),
    )


FIRST = sync([0.0, np.nan, 2.0, 3.0], [0.5, 0.0, 0.7, 0.9])
LOOP = sync([0.0, 1.0, 2.0, 3.0], [0.9, 0.9, 0.4, 0.95])


@pytest.mark.parametrize(("deviation_m", "path_m"), [(0.03, 0.005), (0.003, 0.05)])
def test_of_differing_performances_the_less_sure_one_counts(
    deviation_m: float, path_m: float
) -> None:
    result = with_independent_confidence(LOOP, FIRST, spread(deviation_m, path_m))
    np.testing.assert_allclose(result.maps[1].confidence, [0.5, 0.6, 0.4, 0.9])
    np.testing.assert_array_equal(result.maps[0].confidence, np.ones(4))
    np.testing.assert_array_equal(result.maps[1].reference_frame, LOOP.maps[1].reference_frame)


def test_of_one_motion_and_of_one_video_the_loop_s_own_counts() -> None:
    one = spread(0.003, 0.005)
    assert is_one_motion(one.keypoints_m, one.offset_sd)
    assert with_independent_confidence(LOOP, FIRST, spread(0.003, 0.005)) == LOOP
    assert with_independent_confidence(LOOP, FIRST, None) == LOOP


def test_a_video_without_any_match_before_is_not_sure() -> None:
    nowhere = sync([np.nan] * 4, [0.0] * 4)
    result = with_independent_confidence(LOOP, nowhere, spread(0.03, 0.05))
    np.testing.assert_array_equal(result.maps[1].confidence, np.zeros(4))


def test_nor_is_it_surer_of_what_the_reference_does_not_show() -> None:
    def with_phases(of: Sync, confidence: list[float] | None) -> Sync:
        given = with_repetition(of, 1.0)
        assert given.trust is not None
        of_phase = None if confidence is None else np.array(confidence)
        videos = [v.model_copy(update={"phase_confidence": of_phase}) for v in given.trust.videos]
        return given.model_copy(update={"trust": SyncTrust(videos=videos, triples=[])})

    loop = with_phases(LOOP, [0.9, 0.2, 0.9, 0.9])
    first = with_phases(FIRST, [0.4, 0.4, 0.0, 1.0])
    result = with_independent_confidence(loop, first, spread(0.03, 0.05))
    assert result.trust is not None
    assert result.trust.videos[1].phase_confidence is not None
    np.testing.assert_allclose(result.trust.videos[1].phase_confidence, [0.4, 0.2, 0.0, 0.9])
    assert with_independent_confidence(loop, first, None) == loop
    unknown = with_independent_confidence(loop, with_phases(FIRST, None), spread(0.03, 0.05))
    assert unknown.trust == loop.trust


def with_repetition(of: Sync, ratio: float) -> Sync:
    """The second video fits 1.1 s later, its squared distances so many times as large."""
    first, second = (
        VideoTrust(
            id=name,
            phase_s=np.arange(4.0),
            outlier_score=0.5,
            mirror_margin=0.2,
            left_out_frames=1.0,
            left_out_s=0.1,
            left_out_share=1.0,
        )
        for name in of.ids
    )
    second = second.model_copy(update={"repetition_s": 1.1, "repetition_ratio": ratio})
    return of.model_copy(update={"trust": SyncTrust(videos=[first, second], triples=[])})


def test_what_repeats_the_monocular_motions_tell() -> None:
    before, after = with_repetition(FIRST, 1.05), with_repetition(LOOP, 1.5)
    result = with_first_repetitions(after, before)
    assert result.trust is not None
    assert result.trust.videos[1].repetition_ratio == 1.05
    assert np.isnan(result.trust.videos[0].repetition_ratio)
    elsewhere = before.model_copy(update={"reference": "b"})
    assert with_first_repetitions(after, elsewhere) == after
    assert with_first_repetitions(LOOP, before) == LOOP
