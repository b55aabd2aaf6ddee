"""Situations from public bug reports of this field, called as their users would call them.

Each ends with the right value, or with a sentence that names the cause and the remedy. Small files
are made here, of a film whose joints are known, and read as the stage `keypoints` reads them.
"""

import json
import re
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from imocap_core.adapters.keypoint_reading import reading_of
from imocap_core.errors import WorkFailed
from imocap_core.io.frame_access import check_video
from imocap_core.io.readers.keypoint_readers import format_and_layout, read_detections
from imocap_core.io.video import probe
from imocap_core.pipeline.action import read_action
from imocap_core.workspace import check_files
from tests.io import made_keypoints as made
from tests.io.made_film import COUNT, HEIGHT, WIDTH, film, joints
from tests.io.made_videos import write_video

FRAMES = np.arange(COUNT)
SIZE = np.array([WIDTH, HEIGHT])
Make = Callable[[Path], Path]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return film(tmp_path_factory.mktemp("film") / "a.mp4")


def people(
    time: np.ndarray = FRAMES, first: int = 0, numbers: np.ndarray | None = None, xy: object = None
) -> made.People:
    """Frame number -> the person of a moment, of COCO's points; confidence 0.9."""
    places = joints(np.asarray(time, float)) if xy is None else np.asarray(xy)
    numbers = first + np.arange(len(places)) if numbers is None else numbers
    persons = np.concatenate([places, np.full((*places.shape[:2], 1), 0.9)], axis=-1)
    return {int(n): [person] for n, person in zip(numbers, persons, strict=True)}


def array(folder: Path, table: np.ndarray) -> Path:
    np.save(folder / "points.npy", table)
    return folder / "points.npy"


def text(folder: Path, name: str, content: object, encoding: str = "utf-8") -> Path:
    whole = content if isinstance(content, str) else json.dumps(content)
    (folder / name).write_text(whole, encoding=encoding)
    return folder / name


def yolo(frame: int) -> list[dict[str, object]]:
    (person,) = people()[frame]
    return [{"name": "person", "keypoints": dict(zip("xy", person.T.tolist(), strict=False))}]


def openpose(
    folder: Path, name: str = "clip_{:06d}.json", field: str = "pose_keypoints_2d"
) -> Path:
    """A folder with a file a frame; one of them in UTF-16, what systems add beside them."""
    path = folder / "frames"
    path.mkdir()
    for frame, (person,) in people().items():
        content = {"people": [{field: person.ravel().tolist()}]}
        encoding = ("utf-8", "utf-8-sig", "utf-16")[min(frame, 2)]
        text(path, name.format(frame), content, encoding)
        (path / f"._{name.format(frame)}").write_bytes(b"\x00\x05\x16\x07")
    return path


def gapped(folder: Path) -> Path:
    """OpenPose's frames: of some the people are null, one holds nonsense, one nobody."""
    path = openpose(folder)
    text(path, "clip_000005.json", {"people": None})
    text(path, "clip_000006.json", {"people": [{"pose_keypoints_2d": 51 * [float("nan")]}]})
    text(path, "clip_000007.json", {"people": [{"pose_keypoints_2d": 17 * [0, 0, 1]}]})
    text(path, "clip_000008.json", {"people": []})
    return path


def table_csv(folder: Path, end: str = "\n", sep: str = ",", name: str = "points.csv") -> Path:
    heading = ["frame", *(f"{axis}{k}" for k in range(17) for axis in "xyc")]
    rows = [[str(n), *map(str, person.ravel())] for n, (person,) in people().items()]
    rows[4][1:4] = ["None", "", "NaN"]
    lines = end.join(sep.join(row) for row in [heading, *rows])
    return text(folder, name, lines, "utf-8-sig")


GAP = FRAMES[[0, 1, 2, *range(8, 58)]]
MOVENET = np.concatenate([joints(FRAMES)[..., ::-1] / SIZE[::-1], np.ones((COUNT, 17, 1))], axis=-1)
RIGHT: dict[str, tuple[Make, str]] = {  # the words of how they are read, none for as they are
    "macOS and Windows added files and marks": (openpose, ""),
    "OpenPose 1.0 called its points otherwise": (lambda d: openpose(d, field="pose_keypoints"), ""),
    "files end in .JSON": (lambda d: openpose(d, "clip_{}.JSON"), ""),
    "files end in a version": (lambda d: openpose(d, "IMG_2024_{}_30fps_v2.json"), ""),
    "nobody in some frames, as null, NaN, zeros": (gapped, ""),
    "numbered from 1, OpenPose": (
        lambda d: made.write_openpose(d, people(first=1)), "numbered from 1"
    ),
    "numbered from 1, AlphaPose, the end missing": (
        lambda d: made.write_alphapose(d, people(FRAMES[:-3], first=1)), "numbered from 1"
    ),
    "numbered from 1, MMPose, a gap": (
        lambda d: made.write_mmpose(d, people(GAP, numbers=GAP)), "numbered from 1"
    ),
    "numbered from 1, the beginning missing": (
        lambda d: made.write_coco(d, people(FRAMES[20:], first=21)), "numbered from 1"
    ),
    "numbered from 440": (lambda d: made.write_npz(d, people(first=440)), "numbered from 440"),
    "detected beyond the clip's end": (
        lambda d: made.write_npz(d, people(np.arange(72))), "go on after the video's last frame"
    ),
    "OpenPose's keypoint_scale 3": (
        lambda d: made.write_npz(d, people(xy=joints(FRAMES) / SIZE)), "shares .* from 0 to 1"
    ),
    "OpenPose's keypoint_scale 4": (
        lambda d: made.write_npz(d, people(xy=2 * joints(FRAMES) / SIZE - 1)), "from -1 to 1"
    ),
    "MoveNet's output as it is": (lambda d: array(d, MOVENET[:, None, None]), "y before x"),
    "Ultralytics in a dictionary of one's own": (
        lambda d: text(d, "a.json", [{"frame": int(n), "found": yolo(n)} for n in FRAMES]), ""
    ),
    "Ultralytics by frame number": (
        lambda d: text(d, "a.json", {str(n): yolo(n) for n in FRAMES}), ""
    ),
    "Ultralytics as JSON lines": (
        lambda d: text(d, "a.jsonl", "\n".join(json.dumps(yolo(n)) for n in FRAMES)), ""
    ),
    "CSV of Windows, with None and NaN": (lambda d: table_csv(d, "\r\n"), ""),
    "CSV with tabs": (lambda d: table_csv(d, sep="\t", name="points.TSV"), ""),
}  # fmt: skip


@pytest.mark.parametrize("case", RIGHT)
def test_keypoints_are_read(case: str, clip: Path, tmp_path: Path) -> None:
    make, words = RIGHT[case]
    path, info = make(tmp_path), probe(clip)
    kind, layout = format_and_layout(path, None, "coco17")
    given = read_detections(path, kind, layout, size=info.size, names=["a"])
    reading = reading_of(given, info, clip, path)
    detected = reading.read(given, COUNT, layout)
    assert re.search(words, "; ".join(reading.words)) if words else not reading.words
    here = {
        t: p[0] for t, p in zip(detected.frames.tolist(), detected.people, strict=True) if len(p)
    }
    assert len(here) >= (COUNT - (20 if "beginning" in case else 8))
    for t, person in here.items():
        if not np.isnan(person[:, 0]).all():
            assert (
                np.nanmax(np.abs(person[:, :2] - joints(np.array([t]))[0])) < 2
            )  # straight between two
            assert np.isfinite(person[:, 0]).sum() >= 15


def landmarks(folder: Path) -> Path:
    world = [{"x": 0.1, "y": 0.2, "z": 0.3}] * 33
    return text(folder, "a.json", [{"pose_world_landmarks": [world]}])


def cameras(folder: Path) -> Path:
    for camera in ("01", "02"):
        (folder / camera).mkdir()
        text(folder / camera, "000000.json", {})
    return folder


def copied(folder: Path) -> Path:
    path = openpose(folder)
    text(path, "clip_000003 - Copy.json", {"people": []})
    return path


def numbered_points(folder: Path) -> Path:
    rows = [f"{t},{k},{10 * k},{t},0.9" for t in range(3) for k in range(17)]
    return text(folder, "a.csv", "\n".join(["frame,keypoint,x,y,score", *rows]))


def named(name: str, content: str = "something") -> Make:
    return lambda folder: text(folder, name, content)


REFUSED: dict[str, tuple[Make, str]] = {
    "two versions' frames: 65 beside 60": (
        lambda d: made.write_npz(d, people(np.arange(65))), "of 65 frames, and the video has 60; .*"
        "run the detector on this very video"
    ),
    "numbered from 440, of another length": (
        lambda d: made.write_npz(d, people(FRAMES[:40], first=440)),
        r"numbered 440 to 479, and the video has 60 \(0 to 59\); .* or number them from 0",
    ),
    "a part of a longer video": (
        lambda d: made.write_npz(d, people(np.arange(50), first=30)), "numbered 30 to 79"
    ),
    "negative frame numbers": (
        named("a.json", json.dumps([{"image_id": -1, "keypoints": 51 * [1.0]}])),
        "expected a frame number .* got -1; name the pictures",
    ),
    "a frame twice": (
        lambda d: made.write_npz(d, people(numbers=FRAMES - 1)), r"got \[-1\], negative or twice"
    ),
    "a copied file in the folder": (copied, "frame 3 has two files, .*; keep one clip per folder"),
    "MediaPipe's world landmarks alone": (landmarks, "world landmarks, in metres, and no places"),
    "FreeMoCap's file of three cameras": (
        lambda d: array(d, np.ones((3, 5, 33, 2))), "3 times 5, as FreeMoCap's .*; save each camera"
    ),
    "17 numbered points, a row each": (numbered_points, "`imocap formats` lists"),
    "a folder of cameras": (cameras, "found folders of them; name one: 01, 02"),
    "an empty file": (named("a.json", ""), "is empty; run the detector again"),
    "a page instead of a file": (named("a.json", "<html>"), "is not JSON .*; run the detector"),
    "JSON of another kind": (named("a.json", '[{"joints": 3}]'), "`imocap formats` lists"),
    "3D motion": (named("a.trc"), "is a file of 3D motion"),
    "an estimator's result": (named("results.pkl"), "a monocular estimate is given as `initial`"),
    "a video": (named("a.mp4"), "write `keypoints: detect`"),
    "a packed file": (named("a.json.gz"), "is packed; unpack it first"),
    "a spreadsheet": (named("a.xlsx"), "is a spreadsheet; save it as CSV"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_keypoints_are_refused_with_cause_and_remedy(case: str, clip: Path, tmp_path: Path) -> None:
    make, sentence = REFUSED[case]
    path, info = make(tmp_path), probe(clip)
    with pytest.raises(ValueError, match=sentence) as error:  # noqa: PT012  (any of the steps)
        kind, layout = format_and_layout(path, None, None)
        given = read_detections(path, kind, layout, size=info.size, names=["a"])
        reading_of(given, info, clip, path)
    assert "\n" not in str(error.value)


def with_cover(path: Path) -> Path:
    with av.open(str(path), "w") as container:
        cover = container.add_stream("mjpeg", rate=1)
        cover.width, cover.height, cover.pix_fmt = 200, 304, "yuvj420p"
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuv420p"
        for to, count in ((cover, 1), (stream, 10)):
            for _ in range(count):
                picture = np.zeros((to.height, to.width, 3), np.uint8)
                container.mux(to.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            container.mux(to.encode())
    return path


FILMS: dict[str, tuple[Callable[[Path], Path], tuple[int, int], float]] = {
    "its start is at two seconds": (lambda d: write_video(d / "a.mkv", first_pts=50), (96, 64), 25),
    "it has sound": (lambda d: write_video(d / "a.mp4", audio="aac"), (96, 64), 25),
    "a cover comes first": (lambda d: with_cover(d / "a.mkv"), (96, 64), 25),
    "Matroska, named mp4": (lambda d: write_video(d / "a.mkv").rename(d / "a.mp4"), (96, 64), 25),
    "DV's pixels": (lambda d: write_video(d / "a.mov", aspect=Fraction(4, 3)), (128, 64), 25),
    "an odd size": (lambda d: write_video(d / "a.mkv", "ffv1", size=(97, 63)), (97, 63), 25),
}  # fmt: skip


@pytest.mark.parametrize("case", FILMS)
def test_films_are_read(case: str, tmp_path: Path) -> None:
    make, size, fps = FILMS[case]
    info = check_video(make(tmp_path))
    assert (info.size, info.frame_count) == (size, 10)
    assert info.fps == pytest.approx(fps)


PATHS = {
    "clips\\a.mp4": r"there is no .*; write / instead of \\",
    "~/a.mp4": "write the whole path instead of ~",
    "https://youtu.be/x": "is an address; download the file and name it here",
    "clips/A.MP4": r"there is no .*A\.MP4; there is a\.mp4",
}


@pytest.mark.parametrize("given", PATHS)
def test_a_path_that_leads_nowhere(given: str, tmp_path: Path) -> None:
    (tmp_path / "clips").mkdir()
    text(tmp_path / "clips", "a.mp4", "")
    videos = [{"id": 1, "video": given, "keypoints": "clips"}]
    text(tmp_path, "action.yaml", {"name": "serve", "videos": videos})
    with pytest.raises(WorkFailed, match=PATHS[given]):
        check_files(read_action(tmp_path))
