"""The stage keypoints: the performer of each declared video, or a sentence what to do."""

from pathlib import Path

import numpy as np
import pytest

from imocap_core.params import KeypointsParams, Params
from imocap_core.pipeline.action import Action, Declaration
from imocap_core.pipeline.stage import Context, Inputs
from stages import keypoints
from tests.io import made_keypoints
from tests.made_keypoints import standing_at, write_walk

SIZE = (640, 360)
KEYPOINTS = KeypointsParams(
    min_confidence=0.05, max_gap_s=1.0, looks=True, performer="agreement", sides="leave"
)
PARAMS = Params(keypoints=KEYPOINTS)


@pytest.fixture
def folder(tmp_path):
    write_walk(tmp_path / "keypoints" / "v1")
    return tmp_path


def run(folder, **changes):
    given = {
        "id": "v1",
        "keypoints": "keypoints/v1",
        "format": "openpose",
        "layout": "body25",
        "fps": 30.0,
        "size": SIZE,
    } | changes
    context = Context(
        stage="keypoints",
        seed=0,
        reads=frozenset(("declarations", "detections", "videos", "initial")),
        progress=lambda share, what: None,
        report=folder,
        _action=Action(folder, "made", (Declaration(**given),)),
    )
    return keypoints.run(context, Inputs("keypoints", {}), PARAMS).videos[0]


def test_the_performer_of_the_used_frames(folder):
    found = run(folder, frames=(4, 15), focal_px=700.0)
    assert found.frames.tolist() == list(range(4, 15))
    assert found.tracks_found == 2
    assert found.presence == 1.0
    assert found.focal_px == 700.0
    expected = standing_at(100 + 5 * 4)
    assert np.allclose(found.xy_px[0], expected[:, :2])
    low, high = expected[:, :2].min(axis=0), expected[:, :2].max(axis=0)
    assert np.allclose(found.person_box_px[0], [*low, *high])


def test_without_frames_the_whole_clip_is_used(folder):
    assert run(folder).frames.tolist() == list(range(20))


def test_missing_keypoints_are_one_sentence_with_advice(folder):
    with pytest.raises(
        ValueError, match="no 2D keypoints for v1: write `keypoints: detect`"
    ) as said:
        run(folder, keypoints=None, video="clip.mp4")
    assert str(Path("action.yaml")) in str(said.value)
    assert "\n" not in str(said.value)


def test_what_is_not_declared_is_told_by_the_files(folder):
    given = run(folder)
    for left_out in ({"format": None}, {"layout": None}, {"format": None, "layout": None}):
        if "layout" in left_out:
            with pytest.raises(ValueError, match="25 points per person are BODY_25 or BODY_25B"):
                run(folder, **left_out)
        else:
            assert np.array_equal(run(folder, **left_out).xy_px, given.xy_px, equal_nan=True)


def test_other_formats_give_the_same_performer(folder):
    given = run(folder)
    people = {t: [standing_at(500, 0.5), standing_at(100 + 5 * t)] for t in range(20)}
    path = made_keypoints.write_alphapose(folder, people)
    for declared in ({"format": "alphapose"}, {"format": None}):
        found = run(folder, keypoints=path.name, **declared)
        assert found.layout == "body25"
        assert np.allclose(found.xy_px, given.xy_px)


def test_whole_body_keypoints_bring_their_hands(folder):
    people = made_keypoints.people("wholebody133", frames=6, persons=1)
    for found in people.values():
        found[0][:, :2] = people[0][0][:, :2]
    path = made_keypoints.write_coco_wholebody(folder, people)
    found = run(folder, keypoints=path.name, format="wholebody", layout=None, frames=(0, 6))
    assert found.layout == "coco23"
    assert np.allclose(found.xy_px[0], people[0][0][:23, :2], equal_nan=True)
    assert found.confidence.shape == (6, 23)
    assert found.hands.xy_px.shape == (6, 2, 21, 2)
    assert np.allclose(found.hands.xy_px[0].reshape(42, 2), people[0][0][91:, :2])


def test_a_clip_without_people_is_refused(folder):
    for file in (folder / "keypoints" / "v1").iterdir():
        file.write_text('{"people": []}')
    with pytest.raises(ValueError, match="expected a person in frames 0 to 19, found nobody"):
        run(folder)
