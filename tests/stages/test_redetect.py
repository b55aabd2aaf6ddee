"""The stage redetect: which videos and pictures it has looked at, and when it looks at none."""

from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from imocap_core.adapters.redetection import SecondLook
from imocap_core.artifacts.schemas import Redetect
from imocap_core.body.layouts import layout_names
from imocap_core.detect.detection_again import KnownPlaces
from imocap_core.errors import WorkFailed
from imocap_core.params import Params, RedetectParams
from imocap_core.pipeline.stage import Inputs, in_a_sentence
from stages import redetect
from tests.adapters.test_redetection import hit, problem
from tests.report.made import LAYOUT, Made

ROWS = slice(4, 7)
WRIST = layout_names(LAYOUT).index("left_wrist")


@pytest.fixture(scope="module")
def made() -> Made:
    """The second of three videos has the left wrist detected elsewhere in three frames."""
    return hit(Made(count=3), 1, ROWS)


@pytest.fixture
def asked(made: Made, monkeypatch: pytest.MonkeyPatch) -> list[KnownPlaces]:
    """What the detector is asked; it sees every joint exactly where it is expected."""
    questions: list[KnownPlaces] = []

    def look_again(
        places: Sequence[KnownPlaces], *_: Any
    ) -> list[list[SecondLook]]:  # of a detector that has 25 points
        questions.extend(places)
        return [
            [
                SecondLook({"wrist": xy_px[[WRIST]]}, np.column_stack([xy_px, xy_px[:, 0]]), 1.0)
                for xy_px in one.xy_px
            ]
            for one in places
        ]

    monkeypatch.setattr(redetect, "LAYOUT", LAYOUT)
    monkeypatch.setattr(redetect, "look_again", look_again)
    monkeypatch.setattr(redetect, "set_up", lambda *_: Path("python"))
    return questions


def run(made: Made, detected: Sequence[str], params: Params = Params()) -> Redetect:  # noqa: B008
    sync = problem(made).participants.sync(made.sync)
    maps = [
        m.model_copy(update={"reference_frame": f.astype(float), "confidence": np.ones(len(f))})
        for m, f in zip(sync.maps, made.frames, strict=True)
    ]
    for m in maps:
        beyond = m.reference_frame > made.frames[0][-1]
        m.reference_frame[beyond], m.confidence[beyond] = np.nan, 0.0
    given = (made.keypoints, made.camera_motion, made.initial, made.single)
    stored = {type(x): x for x in (*given, made.sync.model_copy(update={"maps": maps}))}
    context = SimpleNamespace(
        declarations=lambda: [SimpleNamespace(id=i, detected=i in detected) for i in made.ids],
        event=lambda: False,
        device="cpu",
        video=lambda i: Path(f"{i}.mp4"),
        action_file=lambda: Path("action.yaml"),
        progress=lambda *_: None,
    )
    result: Redetect = redetect.run(context, Inputs("redetect", {}, stored), params)  # type: ignore[arg-type]
    return result


def test_contradicted_pictures_are_looked_at_and_the_joint_moves(made, asked):
    result = run(made, made.ids)
    (question,) = asked
    assert (question.video.name, question.frames.tolist()) == ("v2.mp4", [6, 7, 8])  # of the file
    (video,) = result.videos
    assert (video.id, video.looked_at.tolist(), video.contradicted) == ("v2", [4, 5, 6], 3)
    assert video.frame.tolist() == [4, 5, 6]
    assert set(video.point.tolist()) == {WRIST}
    np.testing.assert_allclose(video.xy_px, question.xy_px[:, WRIST])


def test_nobody_looks_where_nothing_contradicts_or_our_detector_did_not(made, asked):
    plain = Made(count=3)
    assert run(plain, plain.ids) == Redetect(videos=[], note=redetect.NOTHING)
    assert run(made, ["v1", "v3"]) == Redetect(videos=[], note=redetect.NOTHING)
    assert run(made, []) == Redetect(videos=[], note=redetect.NOBODY)
    off = Params(redetect=RedetectParams(enabled=False))
    assert run(made, made.ids, off) == Redetect(videos=[], note=redetect.NOBODY)
    assert asked == []


def test_a_detector_that_cannot_be_set_up_says_how_to_go_on(made, asked, monkeypatch):
    def broken(*_: Any) -> Path:
        raise WorkFailed("no Python 3.11")

    monkeypatch.setattr(redetect, "set_up", broken)
    with pytest.raises(WorkFailed, match=r"no Python 3\.11; --set redetect.enabled=false does"):
        run(made, made.ids)


def test_what_a_stage_cannot_do_is_no_fault_of_the_program() -> None:
    def lacking() -> Redetect:
        return Inputs("refine_sync", {}).get(Redetect)

    with pytest.raises(WorkFailed) as fault:
        in_a_sentence("refine_sync", lacking)
    assert str(fault.value).startswith("refine_sync: pipeline.yaml: stages.refine_sync.inputs: ")
    assert "a pipeline.yaml of an older version" in str(fault.value)
    assert "fault of the program" not in str(fault.value)
