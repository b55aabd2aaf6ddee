"""C3D files, read back by a plain reader and, where an interpreter has them, by ezc3d and c3d."""

import json
import os
import struct
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.io.writers.c3d import C3dEvent, C3dTrial, c3d_bytes

# a plain reader of C3D files, after c3d.org, to check the writer with
BLOCK = 512


def read_c3d(content: bytes) -> tuple[dict[str, Any], np.ndarray]:
    """Header and parameters by GROUP:NAME, and the points (T, N, 4)."""
    at, key, points, _, first, last, _ = struct.unpack("<BBHHHHH", content[:12])
    assert key == 80
    scale, data_start, _, fps = struct.unpack("<fHHf", content[12:24])
    values: dict[str, Any] = {"first": first, "last": last, "fps": fps, "scale": scale}
    values |= _parameters(content[(at - 1) * BLOCK :])
    assert values["POINT:DATA_START"] == data_start
    numbers = np.frombuffer(content[(data_start - 1) * BLOCK :], dtype="<f4")
    count = last - first + 1
    return values, numbers[: count * points * 4].reshape(count, points, 4)


def _parameters(section: bytes) -> dict[str, Any]:
    one, key, blocks, kind = section[:4]
    assert (one, key, kind) == (1, 80, 84)
    groups, values, at = {}, {}, 4
    while section[at]:
        length, group = struct.unpack("<bb", section[at : at + 2])
        name = section[at + 2 : at + 2 + length].decode()
        at += 2 + length
        (following,) = struct.unpack("<h", section[at : at + 2])
        if group < 0:
            groups[-group] = name
        else:
            values[f"{groups[group]}:{name}"] = _value(section[at + 2 : at + following])
        at += following
        assert at < blocks * BLOCK
    return values


def _value(content: bytes) -> Any:
    size, dimensions = struct.unpack("<bB", content[:2])
    shape = tuple(content[2 : 2 + dimensions])
    count = int(np.prod(shape, dtype=int))
    data = content[2 + dimensions : 2 + dimensions + count * abs(size)]
    if size == -1:
        width = shape[0]
        texts = [data[k : k + width].decode().rstrip() for k in range(0, len(data), width or 1)]
        return texts[0] if dimensions == 1 else texts
    numbers = np.frombuffer(data, dtype={1: "u1", 2: "<u2", 4: "<f4"}[size])
    return numbers[0] if dimensions == 0 else numbers.reshape(shape[::-1])


READERS = os.environ.get("IMOCAP_C3D")
FRAMES = 7


def trial(first: int = 41, markers: int = 3) -> C3dTrial:
    rng = np.random.default_rng(4)
    points = {f"marker{k}": 1000 * rng.normal(size=(FRAMES, 3)) for k in range(markers)}
    points["marker1"][2] = np.nan
    sd = np.array([0.0, 3.2, np.nan, 40, 127.5, 999, 0.1])
    return C3dTrial(
        subject="somebody", up="z", fps=59.94, first=first, markers_mm=points,
        sd_mm={"marker0": sd}, angles_deg={"LKneeAngles": 40 * rng.normal(size=(FRAMES, 3))},
        descriptions={"LKneeAngles": "flexion"},
        events=[C3dEvent("Foot Off", "Left", 61.25), C3dEvent("Foot Strike", "Right", 0.7)],
    )  # fmt: skip


def test_a_trial_comes_back() -> None:
    made = trial()
    values, points = read_c3d(c3d_bytes(made))
    assert (values["first"], values["last"]) == (41, 47)
    assert values["fps"] == values["POINT:RATE"] == pytest.approx(59.94)
    assert values["POINT:LABELS"] == ["marker0", "marker1", "marker2", "LKneeAngles"]
    assert values["POINT:DESCRIPTIONS"] == ["", "", "", "flexion"]
    assert values["POINT:ANGLES"] == ["LKneeAngles"]
    assert (values["POINT:UNITS"], values["POINT:ANGLE_UNITS"]) == ("mm", "deg")
    assert (values["POINT:X_SCREEN"], values["POINT:Y_SCREEN"]) == ("+X", "+Z")
    sources = [*made.markers_mm.values(), *made.angles_deg.values()]
    for k, source in enumerate(sources):
        there = np.isfinite(source[:, 0])
        np.testing.assert_allclose(points[there, k, :3], source[there], rtol=1e-6)
        np.testing.assert_array_equal(points[:, k, 3] < 0, ~there)


def test_the_residual_is_the_standard_deviation_and_never_less_unless_beyond_its_range() -> None:
    values, points = read_c3d(c3d_bytes(trial()))
    residual = points[:, 0, 3] * abs(values["scale"])
    np.testing.assert_allclose(residual, [0, 3.5, 0, 40, 127.5, 127.5, 0.5])


def test_events_are_in_order_in_minutes_and_seconds() -> None:
    values, _ = read_c3d(c3d_bytes(trial()))
    assert values["EVENT:USED"] == 2
    assert values["EVENT:LABELS"] == ["Foot Strike", "Foot Off"]
    assert values["EVENT:CONTEXTS"] == ["Right", "Left"]
    np.testing.assert_allclose(values["EVENT:TIMES"], [[0, 0.7], [1, 1.25]], rtol=1e-6)


def test_long_films_and_many_labels_are_held() -> None:
    values, points = read_c3d(c3d_bytes(trial(first=100_000, markers=300)))
    assert points.shape == (FRAMES, 301, 4)
    assert (values["first"], values["last"]) == (1, FRAMES)
    low, high = values["TRIAL:ACTUAL_END_FIELD"]
    assert int(low) + 65536 * int(high) == 100_006
    labels = values["POINT:LABELS"] + values["POINT:LABELS2"]
    assert labels[254:257] == ["marker254", "marker255", "marker256"]


PROGRAM = """
import json, sys, warnings
import c3d, ezc3d
warnings.simplefilter("ignore")
file = ezc3d.c3d(sys.argv[1])
point, event = file["parameters"]["POINT"], file["parameters"]["EVENT"]
of_ezc3d = {
    "rate": file["header"]["points"]["frame_rate"],
    "first": file["header"]["points"]["first_frame"] + 1,
    "labels": point["LABELS"]["value"],
    "angles": point["ANGLES"]["value"],
    "events": [event["LABELS"]["value"], event["TIMES"]["value"].T.tolist()],
    "points": file["data"]["points"][:3].transpose(2, 1, 0).tolist(),
}
with open(sys.argv[1], "rb") as stream:
    reader = c3d.Reader(stream)
    frames = [points for _, points, _ in reader.read_frames()]
of_c3d = {
    "rate": float(reader.point_rate),
    "first": int(reader.first_frame),
    "labels": [label.strip() for label in reader.point_labels],
    "points": [frame[:, :3].tolist() for frame in frames],
    "residuals": [frame[:, 3].tolist() for frame in frames],
}
print(json.dumps([of_ezc3d, of_c3d]))
"""


@pytest.mark.skipif(READERS is None, reason="IMOCAP_C3D names no interpreter with ezc3d and c3d")
def test_programs_of_others_read_the_same(tmp_path: Path) -> None:
    made = trial()
    (tmp_path / "a.c3d").write_bytes(c3d_bytes(made))
    done = subprocess.run(
        [str(READERS), "-c", PROGRAM, tmp_path / "a.c3d"], capture_output=True, check=True
    )
    of_ezc3d, of_c3d = json.loads(done.stdout)
    sources = [*made.markers_mm.values(), *made.angles_deg.values()]
    for by in (of_ezc3d, of_c3d):
        assert by["rate"] == pytest.approx(59.94)
        assert by["first"] == 41
        assert by["labels"] == ["marker0", "marker1", "marker2", "LKneeAngles"]
        points = np.array(by["points"], dtype=float)
        for k, source in enumerate(sources):
            there = np.isfinite(source[:, 0])
            np.testing.assert_allclose(points[there, k], source[there], rtol=1e-6)
    assert np.isnan(np.array(of_ezc3d["points"])[2, 1]).all()
    assert np.array(of_c3d["residuals"])[2, 1] == -1
    assert of_ezc3d["angles"] == ["LKneeAngles"]
    assert of_ezc3d["events"][0] == ["Foot Strike", "Foot Off"]
    np.testing.assert_allclose(of_ezc3d["events"][1], [[0, 0.7], [1, 1.25]], rtol=1e-6)
