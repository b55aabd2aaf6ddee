"""A wrong declaration is refused with its field, what was expected and what was got; of damaged
videos, of other shots and of videos that cannot be used the rest is used."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.adapters.detected_people import (
    _used_frames,
    survey_video,
    tracked_video,
    with_corrected_marks,
)
from imocap_core.adapters.keypoint_reading import (
    at_declared_rate,
    check_declared,
    check_fits_picture,
)
from imocap_core.adapters.tracked_people import Faults, left_out_videos, longest_shot, of_usable
from imocap_core.artifacts.schemas import VideoKeypoints
from imocap_core.body.layouts import layout_names
from imocap_core.io import video
from imocap_core.io.video import VideoInfo, write_h264
from imocap_core.params import KeypointsParams
from imocap_core.pipeline.action import Declaration
from tests.io import made_keypoints as made
from tests.io.damaged_video import FPS, SIZE, write_damaged
from tests.made_keypoints import made_keypoints

FILE = Path("action.yaml")
VIDEO = VideoInfo(29.97, (640, 360), 100)


def declared(**fields: Any) -> Declaration:
    return Declaration(id="v1", **{"keypoints": "k", "video": "a.mp4", **fields})


@pytest.mark.parametrize(
    ("fields", "wrong"),
    [
        ({"size": (3840, 2160)}, r"v1\.size: expected \[640, 360\], as a\.mp4 has, got \[3840"),
        ({"fps": 25.0}, r"v1\.fps: expected 29\.97, as a\.mp4 has, got 25"),
        ({"focal_px": 1e9}, r"v1\.focal_px: expected 128 to 32000 pixels .* 640 x 360, got 1e\+09"),
        ({"focal_px": 0.5}, r"v1\.focal_px: expected 128"),
        (
            {"focal_px": 400.0, "distortion": [-0.4]},
            r"v1\.distortion: expected a lens that shows pictures of 640 x 360, got one that turns "
            r"back on itself 243 pixels from the middle",
        ),
    ],
)
def test_a_declaration_that_the_file_contradicts(fields: dict[str, Any], wrong: str) -> None:
    with pytest.raises(ValueError, match=wrong):
        check_declared(declared(**fields), VIDEO, FILE)


def test_true_declarations_and_none_are_fine() -> None:
    check_declared(declared(size=(640, 360), fps=30.0, focal_px=600.0), VIDEO, FILE)
    check_declared(declared(), VIDEO, FILE)
    alone = declared(video=None, size=(640, 360), fps=12.0)
    check_declared(alone, None, FILE)
    with pytest.raises(ValueError, match=r"focal_px: expected 128"):
        check_declared(declared(video=None, size=(640, 360), fps=9, focal_px=1e9), None, FILE)


@pytest.mark.parametrize("fps", [1e-9, float("inf"), float("nan"), 1e9])
def test_frame_rates_that_no_camera_has(fps: float) -> None:
    with pytest.raises(ValueError, match="fps"):
        declared(video=None, size=(640, 360), fps=fps)


def test_slow_motion_and_a_time_lapse_have_the_declared_rate() -> None:
    for fps in (240.0, 2.0):
        check_declared(declared(fps=fps), VIDEO, FILE)
        taken = at_declared_rate(declared(fps=fps), VIDEO)
        assert (taken.fps, taken.slowed) == pytest.approx((fps, fps / 29.97))
    assert at_declared_rate(declared(fps=30.0), VIDEO) == VIDEO
    slow = VIDEO.taken_at(240.0)  # as a phone's file says
    assert at_declared_rate(declared(fps=29.97), slow).slowed == pytest.approx(1.0)
    assert at_declared_rate(declared(), slow) == slow


def test_pixels_of_another_picture() -> None:
    rng = np.random.default_rng(0)
    xy = rng.uniform(0.2, 0.9, size=(20, 17, 2)) * (640, 360)
    xy[0, 0] = np.nan
    for probed in (True, False):
        check_fits_picture(xy, (640, 360), Path("k"), probed=probed)
        with pytest.raises(ValueError, match=r"k: expected pixels of a picture of 320 x 180, got"):
            check_fits_picture(xy, (320, 180), Path("k"), probed=probed)
    with pytest.raises(ValueError, match="a picture of 3840 x 2160, got points that reach"):
        check_fits_picture(xy, (3840, 2160), Path("k"), probed=False)
    check_fits_picture(xy, (3840, 2160), Path("k"), probed=True)
    check_fits_picture(np.full((2, 17, 2), np.nan), (640, 360), Path("k"), probed=False)


def test_points_on_one_spot_are_nobody() -> None:
    xy = np.full((5, 17, 2), 200.0) + np.arange(5)[:, None, None]
    xy[0] = np.nan
    with pytest.raises(ValueError, match="points that lie on one spot in every frame"):
        check_fits_picture(xy, (640, 360), Path("k"), probed=True)


@pytest.mark.parametrize(("frames", "count"), [((4, 5), 100), (None, 2), (None, 200_001)])
def test_too_few_and_too_many_frames(frames: tuple[int, int] | None, count: int) -> None:
    with pytest.raises(ValueError, match=r"v1\.frames: expected at (least 3|most 200,000) frames"):
        _used_frames(declared(frames=frames), count, FILE)
    assert len(_used_frames(declared(), 3, FILE)) == 3


@pytest.mark.parametrize(
    ("fields", "wrong"),
    [
        ({"distortion": [-0.2]}, "distortion: expected focal_px beside it"),
        ({"distortion": [], "focal_px": 600}, "distortion"),
        ({"distortion": [1, 2, 3], "focal_px": 600}, "distortion: expected k1; k1, k2; k1, k2, p1"),
        ({"distortion": [0.0] * 6, "focal_px": 600}, "distortion"),
        ({"distortion": [float("nan")], "focal_px": 600}, "distortion"),
        ({"distortion": -0.2, "focal_px": 600}, "distortion"),
    ],
)
def test_distortions_that_are_no_lens(fields: dict[str, Any], wrong: str) -> None:
    with pytest.raises(ValueError, match=wrong):
        declared(**fields)
    check_declared(declared(distortion=[-0.2, 0.05], focal_px=600.0), VIDEO, FILE)


CORRECTED = 5


def keypoints(layout: str) -> VideoKeypoints:
    count = len(layout_names(layout))
    xy_px = np.random.default_rng(0).uniform(100.0, 300.0, (CORRECTED, count, 2))
    confidence = np.ones((CORRECTED, count))
    return made_keypoints(np.arange(CORRECTED), layout, xy_px=xy_px, confidence=confidence)


@pytest.mark.parametrize("layout", ["body25", "mediapipe33"])
def test_layouts_without_a_correction_stay_as_they_are(layout: str) -> None:
    detected = keypoints(layout)
    assert with_corrected_marks(detected) is detected
    np.testing.assert_array_equal(detected.marks_px, detected.xy_px)


def test_detections_stay_beside_the_corrected_marks() -> None:
    detected = keypoints("blazepose33")
    corrected = with_corrected_marks(detected)
    np.testing.assert_array_equal(corrected.xy_px, detected.xy_px)
    moved = np.any(corrected.marks_px != corrected.xy_px, axis=(0, 2))
    names = [name for name, m in zip(layout_names("blazepose33"), moved, strict=True) if m]
    assert sorted(names) == ["left_hip", "left_shoulder", "right_hip", "right_shoulder"]


FRAMES = np.arange(100)


def test_a_damaged_middle_is_a_span_and_no_cut(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    write_damaged(path, 100, 40, 49, unreadable=False)
    survey = survey_video(path, FRAMES, SIZE, FPS)
    ((first, last),) = survey.damaged_spans(FRAMES) or []
    assert 38 <= first <= 40
    assert 45 <= last <= 51
    assert survey.damaged.sum() == last - first + 1
    assert survey.cuts == []
    part = FRAMES[:30]
    assert survey_video(path, part, SIZE, FPS).damaged_spans(part) is None


def test_damaged_videos_are_decoded_in_one_thread(tmp_path, monkeypatch):
    """With several, one run in some hundred misses a damaged frame, and what is filled in for lost
    data depends on their number."""
    path = tmp_path / "a.mp4"
    write_damaged(path, 100, 40, 49, unreadable=False)
    opened: list[video.VideoStream] = []
    find = video.video_stream

    def kept(container: Any, of: Path) -> video.VideoStream:
        opened.append(find(container, of))
        return opened[-1]

    monkeypatch.setattr(video, "video_stream", kept)
    survey_video(path, FRAMES, SIZE, FPS)
    assert sum(1 for _ in video.read_gray(path, damaged=True)) == len(FRAMES)
    assert [stream.thread_count for stream in opened] == [1, 1]


def test_a_whole_video_has_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    write_damaged(path, 100, 1, 0, unreadable=False)
    assert survey_video(path, FRAMES, SIZE, FPS).damaged_spans(FRAMES) is None


def test_what_cannot_be_used_is_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    write_damaged(path, 100, 30, 80, unreadable=False)
    with pytest.raises(ValueError, match=r"a\.mp4: 5\d% of its frames are damaged \(between"):
        survey_video(path, FRAMES, SIZE, FPS)
    write_damaged(path, 100, 40, 49, unreadable=True)
    with pytest.raises(ValueError, match=r"a\.mp4: broken, decoding failed after 3\d frames"):
        survey_video(path, FRAMES, SIZE, FPS)
    write_damaged(path, 60, 1, 0, unreadable=False)
    with pytest.raises(ValueError, match=r"expected frames 0 to 99, the video ends after 60"):
        survey_video(path, FRAMES, SIZE, FPS)


COUNT = 40


@pytest.mark.parametrize(
    ("cuts", "unseen", "declared", "expected"),
    [
        ([], 0, None, (10, 110)),
        ([13, 100], 0, None, (13, 100)),
        ([80], 60, None, (80, 110)),
        ([30, 80], 0, 85, (80, 110)),
        ([30, 80], 0, 5, (30, 80)),
    ],
)
def test_the_shot_of_who_is_declared_or_seen_for_longest_is_used(cuts, unseen, declared, expected):
    people = [int(t >= unseen) for t in range(100)]
    assert longest_shot(cuts, np.arange(10, 110), people, declared) == expected


@pytest.mark.parametrize(("first", "stop"), [(0, 39), (0, 25), (1, 40), (2, 39), (0, 40)])
def test_frames_of_another_shot_are_not_used(tmp_path: Path, first: int, stop: int) -> None:
    rng = np.random.default_rng(0)
    scenes = rng.integers(0, 255, (3, 24, 32, 3), dtype=np.uint8).repeat(8, 1).repeat(8, 2)
    shots = [scenes[0 if t < first else 1 if t < stop else 2] for t in range(COUNT)]
    write_h264(tmp_path / "a.mp4", shots, 25)
    person = made.people("coco17", frames=1, persons=1)[0][0] * (0.6, 0.5, 1)
    moved = {t: [person + (0.3 * t, 0, 0)] for t in range(COUNT)}
    file = made.write_npz(tmp_path, moved)
    declared = Declaration(
        id="v1", video="a.mp4", keypoints="rtmlib.npz", format="npz", layout="coco17"
    )
    video = tracked_video(
        declared, file, tmp_path / "a.mp4", tmp_path / "action.yaml", KeypointsParams()
    )
    assert video.people.frames.tolist() == list(range(first, stop))
    assert len(video.people.people) == stop - first
    assert video.survey.cuts == []
    said = [r for r in video.remarks if r.endswith("of another shot: left out")]
    assert len(said) == (stop - first < COUNT)


def solve(video: str) -> str:
    if video.startswith("bad"):
        raise ValueError(f"/home/me/action.yaml: videos.{video}.size: expected [4, 3]\nand more")
    return video.upper()


def test_the_others_are_solved_in_their_order() -> None:
    faults: Faults = {}
    assert of_usable(["v1", "bad", "v2"], solve, faults) == {"v1": "V1", "v2": "V2"}
    assert list(faults) == ["bad"]
    assert of_usable(["v1"], solve, {}) == {"v1": "V1"}


@pytest.mark.parametrize("ids", [["bad"], ["bad", "v1"], ["bad1", "bad2", "v1"]])
def test_too_few_usable_videos_are_one_error_with_every_fault(ids: list[str]) -> None:
    with pytest.raises(ValueError, match=r"videos\.bad") as error:
        of_usable(ids, solve, {})
    for name in ids:
        assert (f"videos.{name}.size" in str(error.value)) == name.startswith("bad")


def test_reasons_are_one_line_and_name_no_absolute_path() -> None:
    faults: Faults = {"bad": "/home/me/k/v1/x.json: broken\nin /home/me/k"}
    names = {Path("/home/me/k"): "k", Path("/home/me/k/v1"): "keypoints of v1"}
    (video,) = left_out_videos(faults, names) or []
    assert (video.id, video.reason) == ("bad", "keypoints of v1/x.json: broken; in k")
    assert left_out_videos({}, names) is None
