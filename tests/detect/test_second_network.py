"""The second network and the second look: where they look, what outputs mean, and what both say
together."""

import json
import math
import subprocess
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import torch

from imocap_core.body import load_free_body
from imocap_core.detect.detection import detect_video, is_set_up
from imocap_core.detect.detection_again import KnownPlaces, look_again
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.detect.environment import python_for
from imocap_core.detect.workers.blazepose import landmarks, movenet, tfjs
from imocap_core.detect.workers.blazepose.course import Course
from imocap_core.detect.workers.blazepose.landmarks import MARGIN, Crop
from imocap_core.detect.workers.blazepose.looks import KINDS, RIM, between
from imocap_core.detect.workers.blazepose.movenet import APART, LEAST_HEAT, PEAKS, peaks_of
from imocap_core.io.readers.mediapipe import read_mediapipe
from imocap_core.io.video import write_h264
from imocap_core.pipeline.make_demo import demo_body
from imocap_core.pipeline.source import PROJECT, closure
from imocap_core.synthetic.yoga_clip import SIZE, DemoClip, make_yoga_clip, pictures
from tests.detect import made_people
from tests.detect.conftest import clip
from tests.detect.test_blazepose import REAL, made_runtime
from tests.detect.test_detection import params

CELLS = 64


def standing() -> landmarks.Landmarks:
    """A body whose joints lie apart from each other: the limbs of each side in a column."""
    body = landmarks.detect_landmarks(
        landmarks.Pyramid(made_people.picture((200, 200))),
        landmarks.Crop(200.0, 200.0, 1.3 * made_people.HEIGHT, 0.0),
        made_people.landmark_network,
    )
    xy = body.xy_px.copy()
    for k, joint in enumerate(movenet.JOINTS):
        xy[joint] = (180 if k < 4 else 220), 160 + 25 * (k % 4)
    return replace(body, xy_px=xy, visibility=np.full(33, 0.8))


def told(
    body: landmarks.Landmarks, away: np.ndarray | float = 0.0, order: list[int] = movenet.JOINTS
) -> landmarks.Landmarks:
    """The body with a second network's points, so many sizes to the right of its own joints
    (`order`: whose are taken for whose)."""
    points = body.xy_px[movenet.POINTS].copy()
    points[movenet.SECOND_POINTS] = body.xy_px[order]
    points[movenet.SECOND_POINTS, 0] += np.asarray(away) * body.next_crop.side / landmarks.MARGIN
    return replace(body, second_xy_px=points)


def centernet(*people: tuple[np.ndarray, float]) -> list[np.ndarray]:
    """Outputs of a network that has people with points (17, 2), in shares of the crop, and heats
    of their middles."""
    heat = np.full((CELLS, CELLS, 17), -9.0, np.float32)
    centre = np.full((CELLS, CELLS, 1), -9.0, np.float32)
    first, offset = (np.zeros((CELLS, CELLS, 34), np.float32) for _ in range(2))
    for points, logit in people:
        places = points[:, ::-1] * CELLS  # row, column
        row, column = np.floor(places.mean(axis=0)).astype(int)
        centre[row, column] = logit
        first[row, column] = (places + 1.5 - (row, column)).ravel()  # the first places are coarse
        for k, (y, x) in enumerate(np.floor(places).astype(int)):
            heat[y, x, k] = 3.0
            offset[y, x, 2 * k : 2 * k + 2] = places[k] - (y, x)
    return [heat, centre, first, offset]


def test_points_are_the_ones_of_the_body_in_the_middle() -> None:
    random = np.random.default_rng(1)
    middle = 0.5 + random.uniform(-0.2, 0.2, (17, 2))
    aside = np.array([0.2, 0.25]) + random.uniform(-0.1, 0.1, (17, 2))
    crop = landmarks.Crop(300.0, 200.0, 150.0, 0.7)
    given: list[np.ndarray] = []

    def network(made: np.ndarray) -> list[np.ndarray]:
        given.append(made)
        return centernet((middle, 2.0), (aside, 2.5))

    there = landmarks.Pyramid(made_people.picture((300, 200)))
    points = movenet.detect_points(there, crop, network)
    assert np.abs(points - crop.in_picture(middle)).max() < 1e-3
    assert np.allclose(given[0], landmarks.pixels(there, crop, movenet.SIZE) / 127.5 - 1, atol=1e-6)


def test_the_second_network_is_given_an_upright_body() -> None:
    body = standing()
    crop = movenet.crop_about(body)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    lying = replace(body, xy_px=(body.xy_px - 200) @ turn.T + 200)
    assert math.isclose(movenet.crop_about(lying).angle, crop.angle + math.pi / 2, abs_tol=1e-9)
    assert math.isclose(movenet.crop_about(lying).side, crop.side)
    for made in (body, lying):
        crop = movenet.crop_about(made)
        inside = (
            np.linalg.solve(crop.axes, (made.xy_px[movenet.POINTS] - (crop.x, crop.y)).T).T + 0.5
        )
        assert inside.min() > 0
        assert inside.max() < 1
        assert math.isclose(np.ptp(inside, axis=0).max(), 1 / landmarks.MARGIN)


def test_where_both_agree_limbs_are_their_mean() -> None:
    body = standing()
    both = movenet.combined(told(body, 0.01))
    moved = (both.xy_px - body.xy_px)[:, 0] / (body.next_crop.side / landmarks.MARGIN)
    assert np.allclose(moved[movenet.JOINTS], 0.005, rtol=0.01)
    assert np.allclose(np.delete(moved, movenet.JOINTS), 0)
    assert np.allclose(both.visibility, body.visibility, rtol=0.02)


def test_where_they_do_not_agree_a_joint_counts_for_less() -> None:
    body, away = standing(), np.zeros(8)
    away[1] = 2 * movenet.DOUBTFUL  # a wrist
    both = movenet.combined(told(body, away))
    wrist = movenet.JOINTS[1]
    assert (
        np.linalg.norm(both.xy_px - body.xy_px, axis=1).max()
        < movenet.NEAR * body.next_crop.side / 50
    )
    lowered = both.visibility < body.visibility
    assert set(np.flatnonzero(lowered)) == {wrist, *movenet.TIPS[wrist]}
    assert np.allclose(both.visibility[lowered], 0.8 / 5)


def test_sides_exchanged_by_the_second_network_are_not_its_disagreement() -> None:
    """Which side is which is judged later: arms exchanged, legs not."""
    body = standing()
    exchanged = [movenet.JOINTS[k] for k in (4, 5, 2, 3, 0, 1, 6, 7)]
    both = movenet.combined(told(body, order=exchanged))
    assert np.allclose(both.xy_px, body.xy_px)
    assert np.allclose(both.visibility, body.visibility)


def test_a_second_network_that_looks_at_somebody_else_is_not_heard() -> None:
    body = standing()
    assert movenet.combined(told(body, 1.5 * movenet.SOMEBODY_ELSE)).xy_px is body.xy_px
    assert movenet.combined(body) is body


def test_a_body_is_doubted_until_both_agree() -> None:
    body = standing()
    assert movenet.is_doubted(body)
    assert not movenet.is_doubted(told(body, 0.5 * movenet.ELSEWHERE))
    assert movenet.is_doubted(told(body, 1.5 * movenet.ELSEWHERE))
    wrong_wrist = np.array([0, 0.3, 0, 0, 0, 0, 0, 0])
    assert not movenet.is_doubted(told(body, wrong_wrist))


def test_between_two_looks_its_points_lie_between_too() -> None:
    a, b = told(standing(), 0.0), told(standing(), 0.02)
    half = between(a, b, 0.25).second_xy_px
    assert np.allclose(half, 0.75 * a.second_xy_px + 0.25 * b.second_xy_px)
    assert between(replace(a, second_xy_px=None), b, 0.5).second_xy_px is b.second_xy_px


def courses(second: bool) -> tuple[list[list[landmarks.Landmarks]], int]:
    """Everybody in a walk, and how often BlazePose's own detector was asked; the second network
    has everything 1 % of the crop further right."""
    asked = 0

    def person_detector(given: np.ndarray) -> list[np.ndarray]:
        nonlocal asked
        asked += 1
        return made_people.blind_person_detector(given)

    def network(given: np.ndarray) -> list[np.ndarray]:
        rows, *_ = made_people.landmark_network((given + 1) / 2)
        points = rows.reshape(-1, 5)[movenet.POINTS, :2] / movenet.SIZE
        return centernet((points + (0.01, 0.0), 3.0))

    course = Course(
        made_people.box_network(), person_detector, made_people.landmark_network, 0.5, 0.5, 5,
        second=network if second else None, every_picture=True,
    )  # fmt: skip
    people = [
        course.next_people(made_people.picture((100 + 4 * t, 150)), t == 11)[0] for t in range(12)
    ]
    return people, asked


def test_people_are_followed_as_without_it_and_told_by_both() -> None:
    """And where both agree, BlazePose's own detector is not asked."""
    (alone, always), (both, hardly) = courses(second=False), courses(second=True)
    assert [len(people) for people in both] == [len(people) for people in alone] == [1] * 12
    assert (always, hardly) == (11, 0)
    for (one,), (two,) in zip(alone, both, strict=True):
        assert one.next_crop == two.next_crop
        moved = two.xy_px - one.xy_px
        assert np.allclose(np.delete(moved, movenet.JOINTS, axis=0), 0)
        right = 0.01 * movenet.crop_about(one).side
        assert np.allclose(moved[movenet.JOINTS, 0], right / 2, atol=0.3 * right)
        assert np.abs(moved[movenet.JOINTS, 1]).max() < 1.0  # pixel: bars in a finer crop


def made_graph(folder: Path) -> tuple[Path, Path, list[np.ndarray]]:
    """A graph of each operation, its weights in half precision, and these weights."""
    random = np.random.default_rng(2)
    shapes = [(3, 3, 3, 8), (8,), (3, 3, 8, 1), (8,), (1, 1, 8, 8), (8,), (1, 1, 8, 2), (2,)]
    arrays = [random.normal(size=shape).astype(np.float16) for shape in shapes]
    names = [f"w{k}" for k in range(len(arrays))]

    def convolution(name: str, op: str, given: str, k: int, stride: int, relu: str = "") -> dict:
        fused = ["Qmlhc0FkZA==", *([relu] if relu else [])]
        return {"name": name, "op": op, "input": [given, names[k], names[k + 1]], "attr": {
            "strides": {"list": {"i": ["1", str(stride), str(stride), "1"]}},
            "padding": {"s": "U0FNRQ=="}, "fused_ops": {"list": {"s": fused}}}}  # fmt: skip

    nodes = [
        {"name": "input", "op": "Placeholder"},
        *({"name": name, "op": "Const"} for name in names),
        {"name": "size", "op": "Const"},
        {"name": "scaled", "op": "Sub", "input": ["input", "one"]},
        convolution("body/conv", "_FusedConv2D", "scaled", 0, 2, "UmVsdTY="),
        convolution("body/depth", "FusedDepthwiseConv2dNative", "body/conv", 2, 2, "UmVsdQ=="),
        {"name": "body/up", "op": "ResizeBilinear", "input": ["body/depth", "size"],
         "attr": {"half_pixel_centers": {"b": True}, "align_corners": {"b": False}}},
        convolution("body/side", "_FusedConv2D", "body/conv", 4, 1),
        {"name": "body/sum", "op": "AddV2", "input": ["body/up", "body/side:0", "^body/conv"]},
        convolution("body/head_0/last", "_FusedConv2D", "body/sum", 6, 1),
        {"name": "after", "op": "Sigmoid", "input": ["body/head_0/last"]},
    ]  # fmt: skip
    weights = [
        {"name": name, "shape": list(array.shape), "dtype": "float32",
         "quantization": {"dtype": "float16", "original_dtype": "float32"}}
        for name, array in zip(names, arrays, strict=True)
    ]  # fmt: skip
    graph, binary = folder / "graph.json", folder / "weights.bin"
    described = {"modelTopology": {"node": nodes}, "weightsManifest": [{"weights": weights}]}
    graph.write_text(json.dumps(described))
    binary.write_bytes(b"".join(array.tobytes() for array in arrays))
    return graph, binary, [array.astype(np.float32) for array in arrays]


def by_torch(given: np.ndarray, arrays: list[np.ndarray]) -> np.ndarray:
    """What the made graph gives for a picture (1, 8, 8, 3)."""
    w = [torch.from_numpy(array) for array in arrays]
    pad, same = torch.nn.functional.pad, (0, 1, 0, 1)  # of an even size halved
    x = torch.from_numpy(given).permute(0, 3, 1, 2)
    conv = torch.conv2d(pad(x, same), w[0].permute(3, 2, 0, 1), w[1], 2).clamp(0, 6)
    depth = torch.conv2d(pad(conv, same), w[2].permute(2, 3, 0, 1), w[3], 2, groups=8).relu()
    up = torch.nn.functional.interpolate(depth, scale_factor=2, mode="bilinear")
    total = up + torch.conv2d(conv, w[4].permute(3, 2, 0, 1), w[5])
    head = torch.conv2d(total, w[6].permute(3, 2, 0, 1), w[7])
    return head.permute(0, 2, 3, 1).numpy()


def test_weights_are_read_in_their_precision(tmp_path: Path) -> None:
    graph, binary, arrays = made_graph(tmp_path)
    read = tfjs.weights_of(json.loads(graph.read_text()), binary.read_bytes())
    for k, array in enumerate(arrays):
        assert read[f"w{k}"].dtype == np.float32
        assert np.array_equal(read[f"w{k}"], array)


def test_a_translated_graph_computes_the_same(tmp_path: Path) -> None:
    detector = detector_of(params(detector="blazepose"), tmp_path)
    if not is_set_up(detector):
        pytest.skip("not set up: imocap detect --setup")
    *_, arrays = made_graph(tmp_path)
    given = np.random.default_rng(3).normal(size=(1, 8, 8, 3)).astype(np.float32)
    np.save(tmp_path / "given.npy", given)
    script = """if True:
        import sys
        from pathlib import Path
        import numpy as np
        from ai_edge_litert.interpreter import Interpreter
        folder = Path(sys.argv[1])
        sys.path.insert(0, sys.argv[2])
        from blazepose.tfjs import litert_model
        model = litert_model(folder / "graph.json", folder / "weights.bin", ["head"], 8)
        interpreter = Interpreter(model_content=model)
        interpreter.allocate_tensors()
        interpreter.set_tensor(
            interpreter.get_input_details()[0]["index"], np.load(folder / "given.npy"))
        interpreter.invoke()
        (output,) = interpreter.get_output_details()
        np.save(folder / "made.npy", interpreter.get_tensor(output["index"]))
    """
    python, workers = python_for(detector.packages, print), detector.worker.parent
    subprocess.run([python, "-P", "-c", script, tmp_path, workers], check=True, capture_output=True)
    assert np.allclose(np.load(tmp_path / "made.npy"), by_torch(given, arrays), atol=1e-3)


__all__ = ["made_runtime"]  # a fixture
FRAMES = 6
NAMES = load_free_body().points("body25").names


def rendered(name: str, folder: Path) -> tuple[Detector, DemoClip, Path, Path]:
    """A detector, a rendered body, its film, and what is detected in some of its frames."""
    detector = detector_of(params(detector=name), folder)
    if not is_set_up(detector):
        pytest.skip(f"not set up: imocap detect --setup --set detect.detector={name}")
    shaped, python = demo_body(7), python_for(detector.packages, print)
    take = make_yoga_clip(7, 0, shaped)
    video, file = folder / "v1.mp4", folder / "detections.npz"
    write_h264(video, islice(pictures(take, 7, 0, shaped), FRAMES), take.fps)
    detect_video(video, file, detector, python, lambda share, what: None)
    return detector, take, video, file


def upright(hips: tuple[float, float], reach_px: float) -> np.ndarray:
    """33 points: hips in one place, shoulders above, and the farthest so far away."""
    points = np.tile(hips, (33, 1)).astype(float)
    points[[11, 12], 1] -= 0.5 * reach_px
    points[0, 1] -= reach_px
    return points


def test_each_picture_is_cropped_about_its_own_place(tmp_path: Path, made_runtime: Path) -> None:
    """The stand-in sees every point in its middle, a quarter of the side from the top."""
    video = clip(tmp_path / "bar.mp4", [20, None, 22, 24])
    hips, reach = [(30.0, 30.0), (28.0, 20.0)], [10.0, 8.0]
    places = np.stack([upright(h, r) for h, r in zip(hips, reach, strict=True)])
    shares: list[float] = []
    ((first, last),) = look_again(
        [KnownPlaces(video, np.array([1, 3]), places)], REAL, made_runtime, shares.append
    )
    assert (first.presence, last.presence) == (0.0, 1.0)  # the first picture is black
    assert shares == [0.5, 1.0]
    for look, (x, y), r in zip((first, last), hips, reach, strict=True):
        expected = np.array([x, y - 0.25 * 2 * MARGIN * RIM * r])
        np.testing.assert_allclose(look.body[:, :2], np.tile(expected, (33, 1)), atol=1e-6)
        assert {kind: limb.shape for kind, limb in look.limbs_px.items()} == dict.fromkeys(
            KINDS, (2, 2)
        )


def test_the_rendered_body_is_seen_again_from_a_place_that_is_a_little_off(tmp_path: Path) -> None:
    detector, take, video, file = rendered("blazepose", tmp_path)
    frames = np.array([1, 4])
    people = read_mediapipe(file, "blazepose33", SIZE).people
    height_px = np.ptp(take.xy_px[0, :, 1])
    places = np.stack([people[k][0][:, :2] for k in frames]) + 0.03 * height_px
    python = python_for(detector.packages, print)
    (looks,) = look_again([KnownPlaces(video, frames, places)], detector, python, lambda _: None)
    for frame, look in zip(frames, looks, strict=True):
        assert look.presence > 0.9
        for kind, limbs in look.limbs_px.items():
            assert len(limbs) >= 4  # both sides, both networks
            for side in ("left", "right"):
                true_px = take.xy_px[frame, NAMES.index(f"{side}_{kind}")]
                assert np.linalg.norm(limbs - true_px, axis=1).min() < 0.04 * height_px


def test_peaks_are_the_places_of_highest_heat_that_lie_apart() -> None:
    heat = np.full((64, 64, 17), -9.0, np.float32)
    heat[10, 20, 3], heat[11, 21, 3], heat[40, 50, 3] = 2.0, 1.5, 3.0
    heat[30, 30, 4] = np.log(LEAST_HEAT / (1 - LEAST_HEAT)) - 0.1
    heat[5 : 5 + 2 * APART * (PEAKS + 1) : 2 * APART, 7, 5] = 1.0
    offset = np.zeros((64, 64, 34), np.float32)
    offset[40, 50, 2 * 3 : 2 * 3 + 2] = 0.25, 0.5  # down, right
    peaks = peaks_of([heat, heat[..., :1], offset, offset], Crop(32.0, 32.0, 64.0, 0.0))
    np.testing.assert_allclose(peaks[3], [[50.5, 40.25], [20.0, 10.0]])
    assert [len(peaks[k]) for k in (4, 5, 6)] == [0, PEAKS, 0]


def test_a_second_look_depends_on_the_code_that_looks() -> None:
    depends = closure(PROJECT / "stages" / "redetect.py")
    workers = "imocap_core.detect.workers"
    beside = {f"{workers}.{name}" for name in ("blazepose_again", "blazepose_pose", "exchange")}
    inside = {f"{workers}.blazepose.{n}" for n in ("looks", "landmarks", "movenet")}
    assert beside | inside <= set(depends)


JOINTS = {"left_shoulder": 11, "right_shoulder": 12, "left_hip": 23, "left_knee": 25}


@pytest.mark.parametrize("name", ["mediapipe", "blazepose"])
def test_it_finds_the_rendered_body_where_it_is(tmp_path: Path, name: str) -> None:
    _, take, _, file = rendered(name, tmp_path)
    detections = read_mediapipe(file, "mediapipe33", SIZE)
    assert [len(people) for people in detections.people] == [1] * FRAMES
    height_px = np.ptp(take.xy_px[0, :, 1])
    for joint, point in JOINTS.items():
        true_px = take.xy_px[FRAMES - 1, NAMES.index(joint)]
        point_px = detections.people[-1][0, point]
        assert np.linalg.norm(point_px[:2] - true_px) < 0.06 * height_px, joint
        assert point_px[2] > 0.5, joint
