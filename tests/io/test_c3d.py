"""C3D files, read back by a plain reader and, where an interpreter has them, by ezc3d and c3d."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from imocap_core.io.writers.c3d import C3dEvent, C3dTrial, c3d_bytes
from tests.io.c3d_reader import read_c3d

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
