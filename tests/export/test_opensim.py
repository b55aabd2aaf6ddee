"""Files for OpenSim: the model moved by our angles is where the markers are; OpenSim agrees."""

import os
from pathlib import Path
from xml.etree.ElementTree import Element, parse

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.errors import WrongUse
from tests.pipeline.made_result import Made, made_result
from tools.check_in_opensim import differences_deg, read_storage, solve, with_raised_arms


def marker_places_m(model: Path, values: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Every marker (T, 3) in the ground's axes. values: coordinates over time, radians, metres."""
    root = parse(model).getroot()
    count = len(next(iter(values.values())))
    frames = {"/ground": (np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))}
    for joint in root.iter("CustomJoint"):
        offsets = {f.get("name"): f for f in joint.iter("PhysicalOffsetFrame")}
        parent = offsets[text(joint, "socket_parent_frame")]
        child = offsets[text(joint, "socket_child_frame")]
        assert not numbers(child, "translation").any()
        R, origin = frames[text(parent, "socket_parent")]
        origin = origin + R @ numbers(parent, "translation")
        turns, moves = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        for transform in joint.iter("TransformAxis"):
            coordinate = (transform.find("coordinates").text or "").strip()  # type: ignore[union-attr]
            amount = values[coordinate] if coordinate else np.zeros(count)
            along = amount[:, None] * numbers(transform, "axis")
            if str(transform.get("name")).startswith("rotation"):
                turns = turns @ Rotation.from_rotvec(along).as_matrix()
            else:
                moves = moves + along
        frames[text(child, "socket_parent")] = (
            R @ turns,
            origin + np.einsum("tij,tj->ti", R, moves),
        )
    places = {}
    for marker in root.iter("Marker"):
        R, origin = frames[text(marker, "socket_parent_frame")]
        places[str(marker.get("name"))] = origin + R @ numbers(marker, "location")
    return places


def text(element: Element, name: str) -> str:
    return str(element.findtext(name)).strip()


def numbers(element: Element, name: str) -> np.ndarray:
    return np.array([float(x) for x in text(element, name).split()])


OPENSIM = os.environ.get("IMOCAP_OPENSIM")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    made = made_result(tmp_path_factory.mktemp("opensim"))
    made.export("opensim")
    return made


def trc(file: Path) -> dict[str, np.ndarray]:
    lines = file.read_text().splitlines()
    names = [name for name in lines[3].split("\t")[2:] if name]
    rows = np.array([[float(x) for x in line.split("\t")] for line in lines[6:]])
    return dict(zip(names, rows[:, 2:].reshape(len(rows), -1, 3).swapaxes(0, 1), strict=True))


def test_the_model_moved_by_our_angles_carries_the_markers(made: Made) -> None:
    motion = read_storage(made.out / "a.mot")
    assert motion.pop("time")[1] == pytest.approx(1 / 30, abs=1e-6)
    values = {n: v if n[-3:-1] == "_t" else np.radians(v) for n, v in motion.items()}
    places, markers = marker_places_m(made.out / "a.osim", values), trc(made.out / "a.trc")
    assert set(places) == set(markers)
    away_mm = {n: np.linalg.norm(1000 * p - markers[n], axis=1).max() for n, p in places.items()}
    assert max(away_mm.values()) < 5
    for centre in ("pelvis", "left_knee", "right_ankle", "left_elbow", "right_wrist", "head"):
        assert away_mm[centre] < 0.01


def test_the_setup_names_the_files_beside_it_and_every_marker(made: Made) -> None:
    tool = parse(made.out / "b_ik.xml").getroot()[0]
    assert (made.out / str(tool.findtext("model_file"))).is_file()
    markers = trc(made.out / str(tool.findtext("marker_file")))
    assert [task.get("name") for task in tool.iter("IKMarkerTask")] == list(markers)
    scale = parse(made.out / "b_generic_scale.xml").getroot()[0]
    pairs = {name for pair in scale.iter("markers") for name in str(pair.text).split()}
    generic = parse(made.out / "generic_markers.xml").getroot()
    assert pairs <= {marker.get("name") for marker in generic.iter("Marker")} <= set(markers)


def test_segments_have_the_mass_of_the_whole_body(made: Made) -> None:
    model = parse(made.out / "a.osim").getroot()
    masses = {b.get("name"): float(str(b.findtext("mass"))) for b in model.iter("Body")}
    assert 40 < sum(masses.values()) < 100
    assert masses["left_thigh"] == masses["right_thigh"] > masses["left_shank"] > 1


def test_opensim_has_no_z_up(made: Made) -> None:
    with pytest.raises(WrongUse, match="--up z"):
        made.export("opensim", up="z")


def test_a_negative_elevation_is_the_positive_one_in_the_opposite_plane() -> None:
    names = [f"left_shoulder_{n}" for n in ("plane", "elevation", "internal_rotation")]
    angles = np.random.default_rng(0).uniform(-170, 170, size=(3, 20))
    raised = with_raised_arms(dict(zip(names, angles, strict=True)))
    both = angles, np.stack([raised[name] for name in names])
    assert (both[1][1] >= 0).all()
    R = [Rotation.from_euler("YXY", (a.T * [1, -1, 1]), degrees=True).as_matrix() for a in both]
    np.testing.assert_allclose(R[0], R[1], atol=1e-9)


@pytest.mark.skipif(OPENSIM is None, reason="IMOCAP_OPENSIM names no interpreter with opensim")
def test_opensim_finds_our_angles(made: Made) -> None:
    solved = solve(made.out, Path(str(OPENSIM)))
    assert list(solved) == ["a", "b"]
    for video in solved.values():
        assert np.sqrt((video.rms_mm**2).mean()) < 3
        for name, away in differences_deg(video).items():
            assert len(away) == 0 or np.abs(away).mean() < 3, name
