"""Which videos have a body sheet, and in which world it is drawn."""

from dataclasses import replace

import numpy as np
import pytest

from imocap_core.figures.overlays import blank_cell
from imocap_core.figures.sheets import body_sheet, sheet_ids, sheet_videos, upright_world
from imocap_core.figures.style import quiet
from tests.report.made import Made


def _videos(made: Made):
    files = dict.fromkeys(made.ids)
    return sheet_videos(
        made.keypoints, made.camera_motion, made.initial, made.refined, files, made.model
    )


def _misfit(video, px: float):
    errors = np.full(len(video.final.frames), px)
    return replace(video, final=video.final.model_copy(update={"reprojection_px": errors}))


def test_the_reference_and_the_video_that_fits_worst_have_a_sheet() -> None:
    made = Made()
    videos = [_misfit(v, px) for v, px in zip(_videos(made), (9.0, 5.0, 2.0), strict=True)]
    assert sheet_ids(made.refined, videos) == ["v1", "v2"]
    assert sheet_ids(made.refined, [videos[0], _misfit(videos[1], 1.0), videos[2]]) == ["v1", "v3"]
    excluded = made.refined.rounds[1].sync.model_copy(update={"excluded": ["v2"]})
    refined = made.refined.model_copy(update={"sync": excluded})
    assert sheet_ids(refined, videos) == ["v1", "v3"]


def test_one_video_alone_has_one_sheet() -> None:
    made = Made(count=1)
    assert sheet_ids(made.refined, _videos(made)) == ["v1"]


def test_the_world_of_the_sheets_is_upright() -> None:
    made = Made()
    ground = upright_world(made.refined)
    assert ground.R_upright_from_world @ [0, -1, 0] == pytest.approx([0, 1, 0], abs=0.1)


def test_a_sheet_without_pictures_has_a_column_for_each_phase_and_one_at_rest() -> None:
    made = Made()
    video, frames = _videos(made)[0], [1, 6, 11]
    camera, ground = made.refined.motion.cameras[0], upright_world(made.refined)
    with quiet():
        figure = body_sheet(
            video, camera, ground, made.model, frames, {t: blank_cell() for t in frames}
        )
    texts = [text.get_text() for text in figure.texts]
    for name in ("picture", "front", "side", "back", "at rest", "frame 1", "frame 6", "frame 11"):
        assert name in texts
