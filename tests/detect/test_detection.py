"""keypoints: detect, with the real worker and a stand-in for the library it calls."""

import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from threading import Event, Timer

import numpy as np
import pytest

import imocap_core.detect.workers
from imocap_core.artifacts.store import Store
from imocap_core.body.layouts import layout_names
from imocap_core.detect import detection
from imocap_core.detect.detection import (
    Worker,
    WorkerGroup,
    detect_video,
    detect_videos,
    detections_file,
)
from imocap_core.detect.detectors import Detector, detector_of, frames_with_people, people_arrays
from imocap_core.detect.environment import FOLDER
from imocap_core.errors import WorkFailed
from imocap_core.files import publish_once
from imocap_core.io.readers.estimates import PerformerBoxes
from imocap_core.io.readers.keypoint_arrays import read_keypoints_npz
from imocap_core.io.readers.keypoint_readers import guess_detections
from imocap_core.io.readers.mediapipe import (
    read_mediapipe,
    read_mediapipe_hands,
    read_mediapipe_world,
)
from imocap_core.io.video import write_h264
from imocap_core.params import DetectParams
from imocap_core.pipeline.source import PROJECT
from tests.detect.conftest import SIZE, clip
from tests.processes import is_running, must_end, needs_proc

# models of the inputs and outputs that rtmlib's have: protobuf by the fields of onnx.proto3
FLOAT, INT64 = 1, 7
INT, INTS = 2, 7
INPUT = "input"


def person_model(file: Path, side: int, boxes: np.ndarray) -> Path:
    """Always these boxes (N, 4), as sure of them as the picture (1, 3, side, side) is bright."""
    count = len(boxes)
    constants = {
        "boxes": boxes[None].astype(np.float32),
        "row": np.array([1, 1, 1]),
        "each": np.full((1, count, 1), 1 / 255, np.float32),
    }
    nodes = [
        _node("ReduceMean", [INPUT], "mean", _attribute("axes", [1, 2, 3])),
        _node("Reshape", ["mean", "row"], "one"),
        _node("Mul", ["one", "each"], "scores"),
        _node("Concat", ["boxes", "scores"], "dets", _attribute("axis", 2)),
    ]
    return _write(file, (1, 3, side, side), nodes, constants, {"dets": (1, count, 5)})


def pose_model(file: Path, size: tuple[int, int], points: np.ndarray) -> Path:
    """Always these points (K, 2), shares of the picture (1, 3, height, width) it is given, as two
    peaks each over twice as many places as there are pixels."""
    width, height = size
    shapes = {"simcc_x": (1, len(points), 2 * width), "simcc_y": (1, len(points), 2 * height)}
    constants = {}
    for axis, (name, shape) in enumerate(shapes.items()):
        peaks = np.zeros(shape, np.float32)
        peaks[0, np.arange(len(points)), (points[:, axis] * shape[2]).astype(int)] = 0.75
        constants[f"{name}_peaks"] = peaks
    nodes = [_node("Identity", [f"{name}_peaks"], name) for name in shapes]
    return _write(file, (1, 3, height, width), nodes, constants, shapes)


def _write(
    file: Path,
    given: Sequence[int],
    nodes: Sequence[bytes],
    constants: dict[str, np.ndarray],
    results: dict[str, tuple[int, ...]],
) -> Path:
    graph = b"".join(_bytes(1, node) for node in nodes) + _bytes(2, b"made")
    graph += b"".join(_bytes(5, _tensor(name, value)) for name, value in constants.items())
    graph += _bytes(11, _value(INPUT, given))
    graph += b"".join(_bytes(12, _value(name, shape)) for name, shape in results.items())
    file.write_bytes(_number(1, 8) + _bytes(7, graph) + _bytes(8, _number(2, 13)))
    return file


def _node(kind: str, inputs: Sequence[str], output: str, *attributes: bytes) -> bytes:
    message = b"".join(_bytes(1, name.encode()) for name in inputs) + _bytes(2, output.encode())
    message += _bytes(4, kind.encode())
    return message + b"".join(_bytes(5, attribute) for attribute in attributes)


def _attribute(name: str, value: int | list[int]) -> bytes:
    if isinstance(value, int):
        return _bytes(1, name.encode()) + _number(3, value) + _number(20, INT)
    return _bytes(1, name.encode()) + b"".join(_number(8, v) for v in value) + _number(20, INTS)


def _tensor(name: str, value: np.ndarray) -> bytes:
    message = b"".join(_number(1, side) for side in value.shape)
    message += _number(2, FLOAT if value.dtype == np.float32 else INT64)
    return message + _bytes(8, name.encode()) + _bytes(9, value.tobytes())


def _value(name: str, shape: Sequence[int]) -> bytes:
    sides = b"".join(_bytes(1, _number(1, side)) for side in shape)
    tensor = _number(1, FLOAT) + _bytes(2, sides)
    return _bytes(1, name.encode()) + _bytes(2, _bytes(1, tensor))


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _bytes(field: int, value: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(value)) + value


def _varint(value: int) -> bytes:
    encoded = bytearray()
    while value >= 128:
        encoded.append(value & 127 | 128)
        value >>= 7
    return bytes([*encoded, value])


COLUMNS = [20, 22, None, 30, 40]


def params(**changes: object) -> DetectParams:
    return replace(DetectParams(), **({"detector": "mediapipe"} | changes))  # type: ignore[arg-type]


def detected(tmp_path: Path, python: Path, **changes: object) -> Path:
    video, file = clip(tmp_path / "bar.mp4", COLUMNS), tmp_path / "out" / "detections.npz"
    shares: list[float] = []
    file.unlink(missing_ok=True)
    detector = detector_of(params(**changes), tmp_path)
    detect_video(video, file, detector, python, lambda share, what: shares.append(share))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert [p.name for p in file.parent.iterdir()] == ["detections.npz"]
    return file


def test_what_is_written_is_what_the_readers_read(tmp_path: Path, detector_python: Path) -> None:
    file = detected(tmp_path, detector_python)
    assert guess_detections(file) == ("mediapipe", "mediapipe33")
    detections = read_mediapipe(file, "mediapipe33", SIZE)
    assert detections.frames.tolist() == [0, 1, 2, 3, 4]
    assert [len(people) for people in detections.people] == [1, 1, 0, 1, 1]
    for frame in (0, 1, 3, 4):
        column = COLUMNS[frame]
        assert abs(detections.people[frame][0, 0, 0] - column) <= 2.5
        assert np.isclose(detections.people[frame][0, 32, 2], 0.82)
    boxes = np.tile([0.0, 0.0, *SIZE], (5, 1))
    world = read_mediapipe_world(file, PerformerBoxes(np.arange(5), boxes, SIZE))
    assert np.isnan(world.joints[2]).all()
    assert np.allclose(world.joints[0, :, 2], 0.01 * np.arange(33))


def test_detections_that_another_run_made_meanwhile_stay(tmp_path, detector_python):
    """A stage may be reading them."""
    video, file = clip(tmp_path / "bar.mp4", COLUMNS), tmp_path / "out" / "detections.npz"
    file.parent.mkdir()

    def other_run(share: float, what: str) -> None:
        file.write_bytes(b"theirs")

    detect_video(video, file, detector_of(params(), tmp_path), detector_python, other_run)
    assert file.read_bytes() == b"theirs"
    assert [p.name for p in file.parent.iterdir()] == ["detections.npz"]


@pytest.mark.parametrize("has_links", [True, False])
def test_a_file_is_published_once(tmp_path, monkeypatch, has_links):
    if not has_links:
        monkeypatch.setattr("os.link", refuse)
    for content in (b"first", b"second"):
        draft = tmp_path / "draft"
        draft.write_bytes(content)
        publish_once(draft, tmp_path / "file")
        assert (tmp_path / "file").read_bytes() == b"first"


def refuse(*_: object) -> None:
    raise PermissionError(1, "Operation not permitted")


def test_hands_are_read_where_they_were_asked_for(tmp_path: Path, detector_python: Path) -> None:
    file = detected(tmp_path, detector_python, hands=True)
    hands = read_mediapipe_hands(file, np.array([2, 3]), SIZE)
    xy_px, confidence = hands
    assert confidence.sum(axis=2).tolist() == [[0, 0], [21, 0]]
    assert np.isnan(xy_px[0]).all()
    assert abs(xy_px[1, 0, 0, 0] - 30) <= 2.5
    without = detected(tmp_path, detector_python)
    assert read_mediapipe_hands(without, np.array([2, 3]), SIZE) is None


def test_a_result_is_named_by_all_that_it_depends_on(tmp_path: Path) -> None:
    store = Store(tmp_path / "artifacts")
    videos = [clip(tmp_path / "a.mp4", COLUMNS), clip(tmp_path / "b.mp4", COLUMNS[::-1])]
    again = Path(shutil.copy(videos[0], tmp_path / "c.mp4"))
    settings = ({}, {"hands": True}, {"min_detection_confidence": 0.7}, {"detector": "rtmlib"})
    names = {
        detections_file(store, video, detector_of(params(**changes), tmp_path))
        for video in videos
        for changes in settings
    }
    assert len(names) == 8
    assert detections_file(store, again, detector_of(params(), tmp_path)) in names
    unused = detector_of(params(rtmlib_pose_model="pose.onnx"), tmp_path)
    assert detections_file(store, videos[0], unused) in names


@pytest.mark.parametrize(
    ("columns", "environment", "sentence"),
    [
        ([None, None], {}, r"a\.mp4: mediapipe 0\.10\.21 found no person in 2 frames"),
        (COLUMNS, {"FAKE_DIES_AT": "2"}, "_pose in .* ended without an answer: the model"),
        (COLUMNS, {"FAKE_DIES_AT": "2", "FAKE_HANGS": "1"}, "gave no answer for 6 s and was ended"),
        (COLUMNS, {"PYTHONPATH": ""}, "failed: ModuleNotFoundError: No module named"),
    ],
    ids=["nobody", "dies", "hangs", "no library"],
)
def test_what_fails_is_one_sentence_and_leaves_nothing(
    tmp_path, detector_python, monkeypatch, columns, environment, sentence
):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(detection, "ANSWER_S", 6.0)  # long enough for it to start
    video, detector = clip(tmp_path / "a.mp4", columns), detector_of(params(), tmp_path)
    with pytest.raises(WorkFailed, match=sentence):
        detect_video(video, tmp_path / "o" / "f.npz", detector, detector_python, lambda s, w: None)
    assert not (tmp_path / "o").exists()


def test_settings_reach_the_worker_as_they_are(tmp_path: Path) -> None:
    detector = detector_of(params(min_detection_confidence=0.25), tmp_path)
    assert json.loads(json.dumps(detector.settings))["min_detection_confidence"] == 0.25
    assert detector.version == "mediapipe 0.10.21"


LENGTHS = (9, 4, 6)


@pytest.fixture(params=[1, 3], ids=["one core", "three cores"])
def many_cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    count: int = request.param
    monkeypatch.setattr(detection, "cores", lambda: count)
    return count


@pytest.fixture
def detector(tmp_path: Path, detector_python: Path) -> Detector:
    return detector_of(DetectParams(detector="mediapipe"), tmp_path)


def videos(folder: Path, nobody_in: int | None = None) -> dict[Path, Path]:
    return {
        folder / "out" / f"{row}.npz": clip(
            folder / f"{row}.mp4", [None if row == nobody_in else 20 + t for t in range(n)]
        )
        for row, n in enumerate(LENGTHS)
    }


@pytest.mark.usefixtures("many_cores")
def test_every_video_has_its_detections_and_the_share_only_grows(
    tmp_path, detector, detector_python
):
    made, shares = videos(tmp_path), list[float]()
    detect_videos(made, detector, detector_python, lambda share, what: shares.append(share))
    assert shares == sorted(shares)
    assert len(shares) == sum(LENGTHS)
    assert np.isclose(shares[-1], 1.0)
    for file, frames in zip(made, LENGTHS, strict=True):
        with np.load(file) as arrays:
            assert len(arrays["frames"]) == frames


@pytest.mark.usefixtures("many_cores")
def test_the_others_are_finished_where_one_fails(tmp_path, detector, detector_python):
    made = videos(tmp_path, nobody_in=1)
    with pytest.raises(WorkFailed, match=r"1\.mp4: mediapipe 0\.10\.21 found no person"):
        detect_videos(made, detector, detector_python, lambda share, what: None)
    assert [file.is_file() for file in made] == [True, False, True]


def test_detectors_that_hang_end_with_an_interrupted_run(
    tmp_path, detector, detector_python, monkeypatch
):
    """The interrupt reaches the main thread only, as Ctrl-C does."""
    monkeypatch.setattr(detection, "cores", lambda: 3)
    monkeypatch.setenv("FAKE_DIES_AT", "2")
    monkeypatch.setenv("FAKE_HANGS", "1")
    all_hang = Event()
    workers: list[Worker] = []

    class Pool(detection.ThreadPoolExecutor):
        def map(self, work, rows, **more):  # type: ignore[no-untyped-def]
            super().map(work, rows, **more)
            assert all_hang.wait(60)
            raise KeyboardInterrupt

    def progress(share: float, what: str) -> None:
        if share > 0.29:  # two frames of each
            Timer(0.3, all_hang.set).start()

    add = WorkerGroup.add

    def noted(self: WorkerGroup, worker: Worker) -> None:
        workers.append(worker)
        add(self, worker)

    monkeypatch.setattr(detection, "ThreadPoolExecutor", Pool)
    monkeypatch.setattr(WorkerGroup, "add", noted)
    with pytest.raises(KeyboardInterrupt):
        detect_videos(videos(tmp_path), detector, detector_python, progress)
    assert len(workers) == 3
    assert all(worker._process.poll() is not None for worker in workers)
    assert not list(tmp_path.glob("out/*.npz"))


ENVIRONMENT = PROJECT / FOLDER
PYTHON = ENVIRONMENT / "bin" / "python"
WIDTH, HEIGHT, SIDE = 64, 48, 416
# Two people in the person model's picture, which shows the video SIDE / WIDTH times as large.
BOXES = np.array([[65.0, 52.0, 195.0, 260.0], [260.0, 65.0, 325.0, 195.0]])

needs_rtmlib = pytest.mark.skipif(
    not (ENVIRONMENT / ".installed-rtmlib.txt").exists(),
    reason="no rtmlib: imocap detect --setup --set detect.detector=rtmlib",
)


def rtmlib(folder: Path, layout: str, **changes: object) -> Detector:
    count = len(layout_names(layout))
    points = np.column_stack([np.linspace(0.2, 0.8, count), np.full(count, 0.5)])
    person_model(folder / "person.onnx", SIDE, BOXES)
    pose_model(folder / "pose.onnx", (192, 256), points)
    models = {"rtmlib_person_model": "person.onnx", "rtmlib_pose_model": "pose.onnx"}
    return detector_of(params(detector="rtmlib", **models, **changes), folder)


@needs_rtmlib
@pytest.mark.parametrize(("hands", "layout"), [(False, "halpe26"), (True, "wholebody133")])
def test_everybody_is_found_where_the_models_say(tmp_path: Path, hands: bool, layout: str) -> None:
    video, file = tmp_path / "clip.mp4", tmp_path / "detections.npz"
    pictures = [np.full((HEIGHT, WIDTH, 3), grey, np.uint8) for grey in (235, 0, 235)]
    write_h264(video, pictures, 30.0)
    chosen = rtmlib(tmp_path, layout, hands=hands)
    assert chosen.layout == layout
    detect_video(video, file, chosen, PYTHON, lambda share, what: None)
    assert guess_detections(file) == ("npz", layout)
    detections = read_keypoints_npz(file, layout)
    assert [len(people) for people in detections.people] == [2, 0, 2]  # nobody in the dark
    for person, box in zip(detections.people[2], BOXES * WIDTH / SIDE, strict=True):
        middle = (box[:2] + box[2:]) / 2
        assert np.abs(person[:, :2].mean(axis=0) - middle).max() < 0.3
        assert np.all(np.diff(person[:, 0]) >= 0)
        assert np.allclose(person[:, 2], 0.75)


def test_a_model_of_ones_own_is_part_of_the_key(tmp_path: Path) -> None:
    chosen = rtmlib(tmp_path, "halpe26")
    assert [path.name for path in chosen.models] == ["person.onnx", "pose.onnx"]
    assert chosen.key("video", ["a", "b"]) != chosen.key("video", ["a", "c"])
    (tmp_path / "elsewhere").mkdir()
    moved = rtmlib(tmp_path / "elsewhere", "halpe26")
    assert chosen.key("video", ["a", "b"]) == moved.key("video", ["a", "b"])


def test_frames_with_fewer_people_are_filled_up() -> None:
    person = [[1.0, 2.0], [3.0, 4.0]]
    answers = [
        {"keypoints": [person, person], "scores": [[0.5, 0.6], [0.7, 0.8]]},
        {"keypoints": [], "scores": []},
        {"keypoints": [person], "scores": [[0.9, 0.4]]},
    ]
    arrays = people_arrays(answers)
    assert arrays["keypoints"].shape == (3, 2, 2, 2)
    assert arrays["scores"].sum(axis=(1, 2)).tolist() == pytest.approx([2.6, 0.0, 1.3])
    assert np.isnan(arrays["keypoints"][2, 1]).all()
    assert frames_with_people(arrays) == 2
    assert frames_with_people(people_arrays([{"keypoints": [], "scores": []}])) == 0


WORKERS = Path(next(iter(imocap_core.detect.workers.__path__)))
HANGS = f"""
import sys, time
sys.path.insert(0, {str(WORKERS)!r})
import exchange
def make(settings):
    print("hangs", file=sys.stderr, flush=True)
    time.sleep(1e6)
exchange.serve(make)
"""
PROGRAM = """
import subprocess, sys
command = [sys.executable, "-c", sys.argv[1], "{}", sys.argv[2]]
worker = subprocess.Popen(command, stdin=subprocess.PIPE)
print(worker.pid, flush=True)
worker.wait()
"""


@needs_proc
def test_a_detector_that_hangs_ends_when_its_run_is_killed(tmp_path: Path) -> None:
    pictures, pipe = tmp_path / "pictures", subprocess.PIPE
    pictures.touch()
    command = [sys.executable, "-c", PROGRAM, HANGS, str(pictures)]
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as program:
        worker = int(program.stdout.readline())
        assert program.stderr.readline() == "hangs\n"
        assert is_running(worker)
        program.kill()
    must_end(worker, seconds=30)
    assert not pictures.exists()
