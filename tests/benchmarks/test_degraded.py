"""The benchmark of degraded footage: its pictures, its action folders, its choices, its table."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks.degraded import ACTIONS
from benchmarks.degraded_footage import FOOTAGES, THIRDS, degraded_pictures, make_footage
from benchmarks.detector import LEGS, PARTS, SIDES
from imocap_core.io.video import probe, read_rgb, write_h264

FRAMES, SIZE = 12, (112, 96)  # width, height
VIDEOS = ("v1", "v2", "v3", "v4")
BY_NAME = {footage.name: footage for footage in FOOTAGES}


def limbs() -> np.ndarray:
    """Somebody who stands in the middle, in pixels: 12 joints, left, then right."""
    rows = np.array([20, 30, 42, 42, 60, 80], float)
    left, right = (np.column_stack([np.full(6, x), rows]) for x in (60.0, 46.0))
    return np.concatenate([left, right])


def pictures() -> list[np.ndarray]:
    """Light pictures, each with a grey level of its own."""
    return [np.full((SIZE[1], SIZE[0], 3), 100 + 10 * t, np.uint8) for t in range(FRAMES)]


def changed(name: str, video: int = 1, limbs_px: np.ndarray | None = None) -> np.ndarray:
    """The pictures of one degraded video (T, height, width, 3)."""
    where = np.tile(limbs(), (FRAMES, 1, 1)) if limbs_px is None else limbs_px
    return np.stack(list(degraded_pictures(pictures(), where, BY_NAME[name], video)))


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """An action of four videos with keypoints declared, a calibration and a triangulation, in which
    the performer's metres are pixels."""
    folder = tmp_path / "data" / ACTIONS[0]
    (folder / "videos").mkdir(parents=True)
    for video in VIDEOS:
        write_h264(folder / "videos" / f"{video}.mp4", pictures(), 30.0, crf=6)
    eye = np.tile(np.eye(3), (4, 1, 1))
    np.savez(folder / "calibration.npz", K=eye, R=eye, t=np.zeros((4, 3)), cams=np.array(VIDEOS))
    xyz = np.tile(np.column_stack([limbs(), np.ones(12)]), (FRAMES, 1, 1))
    markers = [f"{side[0].upper()}{part.title()}" for side in SIDES for part in PARTS]
    np.savez(folder / "trc_reference.npz", xyz_zup_m=xyz, names=np.array(markers))
    declared = [
        {"id": video, "video": f"videos/{video}.mp4", "keypoints": f"keypoints/{video}"}
        | {"format": "openpose", "layout": "body25b", "frames": [0, FRAMES]}
        for video in VIDEOS
    ]
    (folder / "action.yaml").write_text(yaml.safe_dump({"name": "tiny", "videos": declared}))
    return folder


def made(source: Path, name: str) -> Path:
    folder = source.parents[1] / f"tiny-{name}"
    make_footage(folder, source, BY_NAME[name])
    return folder


def has_hidden_legs(picture: np.ndarray) -> bool:
    return all(picture[int(y), int(x)].max() < 30 for x, y in limbs()[LEGS])


@pytest.mark.parametrize(("video", "begin"), [*enumerate(THIRDS)])
def test_legs_are_hidden_in_their_third_alone(video: int, begin: float) -> None:
    hidden, plain = changed("legs-all", video), np.stack(pictures())
    inside = np.array([begin <= t / FRAMES < begin + 1 / 3 for t in range(FRAMES)])
    assert inside.sum() == FRAMES // 3
    assert [has_hidden_legs(picture) for picture in hidden] == inside.tolist()
    np.testing.assert_array_equal(hidden[~inside], plain[~inside])
    np.testing.assert_array_equal(hidden[:, :35], plain[:, :35])  # above the hips


def test_pictures_without_the_performer_s_place_stay_as_they_are() -> None:
    where = np.tile(limbs(), (FRAMES, 1, 1))
    where[5, 0] = np.nan
    hidden = changed("legs-one", limbs_px=where)
    assert [has_hidden_legs(picture) for picture in hidden[4:8]] == [True, False, True, True]


def test_a_dropped_frame_shows_the_last_picture_again() -> None:
    levels = changed("dropped-one")[:, 0, 0, 0].astype(int)
    plain = np.array([picture[0, 0, 0] for picture in pictures()], int)
    assert len(levels) == FRAMES
    assert levels[0] == plain[0]
    for t in range(1, FRAMES):
        assert levels[t] in (plain[t], levels[t - 1])
    assert 2 < len(set(levels)) < FRAMES - 2
    assert (changed("dropped-all", 2)[:, 0, 0, 0] != levels).any()  # each video drops others


def test_a_degraded_action_is_detected_and_has_the_truth_of_its_source(source: Path) -> None:
    folder = made(source, "legs-one")
    action = yaml.safe_load((folder / "action.yaml").read_text())
    assert action["name"] == "tiny-legs-one"
    assert action["videos"] == [
        {"id": v, "video": f"videos/{v}.mp4", "keypoints": "detect", "frames": [0, FRAMES]}
        for v in VIDEOS
    ]
    for file in ("calibration.npz", "trc_reference.npz", "videos/v1.mp4", "videos/v3.mp4"):
        assert (folder / file).read_bytes() == (source / file).read_bytes()
    assert probe(folder / "videos" / "v2.mp4") == probe(source / "videos" / "v2.mp4")
    inside = [has_hidden_legs(picture) for _, picture in read_rgb(folder / "videos" / "v2.mp4")]
    assert inside == [4 <= t < 8 for t in range(FRAMES)]


def test_a_folder_is_made_once_and_again_when_its_source_changes(source: Path) -> None:
    folder = made(source, "plain")
    before = folder.stat().st_ino
    assert made(source, "plain").stat().st_ino == before
    write_h264(source / "videos" / "v1.mp4", pictures()[::-1], 30.0)
    assert made(source, "plain").stat().st_ino != before
