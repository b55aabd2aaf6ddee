"""Videos of one event: their matches become one offset a video, and phases follow."""

from __future__ import annotations

import numpy as np

from imocap_core.adapters.hints import with_one_offset
from imocap_core.artifacts.schemas import SyncMap, SyncTrust, VideoTrust
from tests.report.made import Made

FRAMES = 40


def test_matches_become_lines_and_phases_follow() -> None:
    made = Made(3, frames=FRAMES)
    position = np.arange(FRAMES) + 5.0
    wobbling = position + 0.4 * np.sin(np.arange(FRAMES))
    wobbling[30:] += 12.0
    maps = [
        SyncMap(id=i, reference_frame=r, confidence=np.ones(FRAMES))
        for i, r in (("v1", np.arange(FRAMES, dtype=float)), ("v2", wobbling), ("v3", position))
    ]
    trust = SyncTrust(
        videos=[
            VideoTrust(id=i, phase_s=np.arange(FRAMES) / 30, outlier_score=0.0, mirror_margin=0.0,
                       left_out_frames=0.0, left_out_s=0.0, left_out_share=0.0, repetition_s=np.nan,
                       repetition_ratio=np.nan)
            for i in ("v1", "v2", "v3")
        ],
        triples=[],
    )  # fmt: skip
    given = made.sync.model_copy(
        update={"reference": "v1", "maps": maps, "trust": trust, "excluded": ["v3"]}
    )
    sync = with_one_offset(given, made.keypoints, None)
    line = sync.maps[1].reference_frame
    inside = np.isfinite(line)
    np.testing.assert_allclose(np.diff(line[inside])[:-1], 1.0)
    np.testing.assert_allclose(line[0], 5.0, atol=0.2)
    assert np.isnan(line[np.arange(FRAMES) + 5 > FRAMES]).all()
    np.testing.assert_allclose(sync.maps[1].confidence[inside], 30 / 40)
    assert sync.maps[2] is maps[2]  # excluded
    assert sync.trust is not None
    fps = made.keypoints.videos[0].fps
    np.testing.assert_allclose(sync.trust.videos[1].phase_s[0], 5.0 / fps, atol=0.2 / fps)
    np.testing.assert_allclose(np.diff(sync.trust.videos[1].phase_s), 1 / fps)


def test_sound_counts_from_the_beginning_of_the_files() -> None:
    made = Made(2, frames=FRAMES)
    used = made.keypoints.videos[1]
    shifted = used.model_copy(update={"frames": used.frames + 6})
    later = made.keypoints.model_copy(update={"videos": [made.keypoints.videos[0], shifted]})
    sync = with_one_offset(made.sync, later, np.array([0.0, 0.5]))
    begun = sync.ids.index(sync.reference)
    other = 1 - begun
    at_zero = np.interp(0.0, np.arange(FRAMES), sync.maps[other].reference_frame)
    first_s = [video.time_s[0] for video in later.videos]
    expected = (first_s[1] + 0.5 - first_s[0]) * used.fps
    np.testing.assert_allclose(at_zero, expected if other == 1 else -expected, atol=0.01)
