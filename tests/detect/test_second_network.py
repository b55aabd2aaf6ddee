"""The second network: where it looks, what its outputs mean, and what both say together."""

import json
import math
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from imocap_core.detect.detection import is_set_up
from imocap_core.detect.detectors import detector_of
from imocap_core.detect.environment import python_for
from imocap_core.detect.workers.blazepose import landmarks, movenet, tfjs
from imocap_core.detect.workers.blazepose.course import Course
from imocap_core.detect.workers.blazepose.looks import between
from tests.detect import made_people
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
