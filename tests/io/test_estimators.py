"""Every reader of monocular 3D estimates: gives back the performer, runs nothing, says what is
wrong; pickles give back what was put in."""

import io
import json
import pickle
import shutil
from collections import OrderedDict, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from imocap_core import unpickle
from imocap_core.body.layouts import hand_columns, layout_names
from imocap_core.conventions import SMPL_JOINTS, SMPLH_JOINTS
from imocap_core.io.array_files import read_results
from imocap_core.io.readers.estimates import NAMES, PerformerBoxes
from imocap_core.io.readers.keypoint_readers import format_and_layout
from imocap_core.io.readers.smpl_estimators import JOINT_READERS, ROTATIONS
from tests.io import made_estimates as made
from tests.io.detector_cases import read as read_keypoints
from tests.io.detector_cases import refused as refused_keypoints
from tests.reduced import Reduced, touching

WRITERS: dict[str, Callable[..., Path]] = {
    "hmr2": made.write_phalp,
    "wham": made.write_wham,
    "vibe": made.write_vibe,
    "hmmr": made.write_hmmr,
    "gvhmr": made.write_gvhmr,
    "gem": made.write_gem,
    "prompthmr": made.write_prompthmr,
    "tram": made.write_tram,
    "tokenhmr": made.write_phalp,
    "sam3d_body": made.write_sam3d_body,
    "mediapipe_world": made.write_mediapipe,
}
# What a reader uses, and a value of the wrong length and of the wrong kind for it.
FIELDS = {
    "hmr2": ("smpl", [{}], [[], []]),
    "wham": ("pose", np.zeros((made.FRAMES, 71)), "text"),
    "vibe": ("bboxes", np.zeros((made.FRAMES - 1, 4)), None),
    "hmmr": ("poses", np.zeros((made.FRAMES, 23, 3, 3)), {}),
    "gvhmr": ("body_pose", torch.zeros(made.FRAMES, 62), 7),
    "gem": ("body_pose", torch.zeros(made.FRAMES, 227), 7),
    "prompthmr": ("bboxes", np.zeros((made.FRAMES, 3)), "text"),
    "tram": ("pred_rotmat", torch.zeros(made.FRAMES, 24, 9), ["a"]),
    "tokenhmr": ("smpl", [{}], [[], []]),
    "sam3d_body": ("pred_keypoints_3d", [[0.0, 0.0, 0.0]] * 69, "text"),
    "mediapipe_world": ("pose_world_landmarks", [[{"x": 0.0}] * 32], [7]),
}
ALL = pytest.mark.parametrize("kind", WRITERS)
PLACED = pytest.mark.parametrize(
    "kind", [*("hmr2", "wham", "vibe", "prompthmr", "tram"), *("sam3d_body", "mediapipe_world")]
)
PICKLED = pytest.mark.parametrize(
    "kind", ["hmr2", "wham", "vibe", "hmmr", "gvhmr", "gem", "prompthmr", "tram"]
)


def wanted(first: int = 1, stop: int = made.FRAMES - 1) -> PerformerBoxes:
    frames = np.arange(first, stop)
    inside = np.clip(frames, 0, made.FRAMES - 1)
    return PerformerBoxes(frames, made.PERFORMER.box_px[inside], made.SIZE)


def read(kind: str, path: Path, what: PerformerBoxes | None = None) -> Any:
    what = wanted() if what is None else what
    return (
        ROTATIONS[kind](path, what) if kind in ROTATIONS else JOINT_READERS[kind](path, what).joints
    )


def expected(kind: str, who: made.Truth = made.PERFORMER) -> np.ndarray:
    if kind == "sam3d_body":
        return made.joints_of(who)[1:-1]
    if kind == "mediapipe_world":
        return made.joints_of(who, 33)[1:-1]
    R = who.R[1:-1].copy()
    if kind in ("gvhmr", "gem", "prompthmr"):  # without SMPL's hands
        R[:, 22:] = np.eye(3)
    return R


def the_file(path: Path) -> Path:
    return path / "hps_track_0.npy" if path.is_dir() else path


def test_every_reader_is_tested() -> None:
    assert set(WRITERS) == {*ROTATIONS, *JOINT_READERS} - {"joints_npz"}


@ALL
def test_the_performer_is_found_among_two_people(kind: str, tmp_path: Path) -> None:
    estimate = read(kind, WRITERS[kind](tmp_path))
    np.testing.assert_allclose(estimate, expected(kind), atol=1e-5)


@ALL
def test_one_person_needs_no_box(kind: str, tmp_path: Path) -> None:
    path = WRITERS[kind](tmp_path, (made.PERFORMER,))
    nowhere = PerformerBoxes(wanted().frames, np.full((len(wanted().frames), 4), np.nan), made.SIZE)
    np.testing.assert_allclose(read(kind, path, nowhere), expected(kind), atol=1e-5)


@PLACED
def test_frames_without_an_estimate_are_nan(kind: str, tmp_path: Path) -> None:
    path = WRITERS[kind](tmp_path)
    estimate = read(kind, path, wanted(2, made.FRAMES + 2))
    assert np.isfinite(estimate[:-2]).all()
    assert np.isnan(estimate[-2:]).all()
    with pytest.raises(ValueError, match="expected an estimate in frames 50 to 51"):
        read(kind, path, PerformerBoxes(np.array([50, 51]), made.PERFORMER.box_px[:2], made.SIZE))


@PLACED
def test_people_elsewhere_are_not_the_performer(kind: str, tmp_path: Path) -> None:
    path = WRITERS[kind](tmp_path)
    far = PerformerBoxes(wanted().frames, wanted().box_px + 150, made.SIZE)
    with pytest.raises(ValueError, match="at the performer's keypoints"):
        read(kind, path, far)


@ALL
@pytest.mark.parametrize("share", [0.0, 0.6, 0.95])
def test_a_truncated_file_is_refused(kind: str, share: float, tmp_path: Path) -> None:
    path = WRITERS[kind](tmp_path)
    content = the_file(path).read_bytes()
    the_file(path).write_bytes(content[: int(share * len(content))])
    refused(kind, path)


@ALL
@pytest.mark.parametrize("content", ["text", {}, [[]], {"a": {}}, None, np.zeros((2, 3))])
def test_a_file_of_something_else_is_refused(kind: str, content: Any, tmp_path: Path) -> None:
    path = WRITERS[kind](tmp_path)
    if path.suffix == ".json":
        plain = content.tolist() if isinstance(content, np.ndarray) else content
        path.write_text(json.dumps(plain))
    elif path.suffix == ".pt":
        torch.save(content, path)
    else:
        the_file(path).write_bytes(pickle.dumps(content))
    refused(kind, path)


@ALL
@pytest.mark.parametrize("which", [1, 2])
def test_a_field_of_wrong_length_or_kind_is_named(kind: str, which: int, tmp_path: Path) -> None:
    name, message = FIELDS[kind][0], ""
    path = WRITERS[kind](tmp_path, **{name: FIELDS[kind][which]})
    message = refused(kind, path)
    assert "expected" in message
    assert "got" in message
    assert name in message or kind in ("hmr2", "tokenhmr", "mediapipe_world")


@ALL
def test_a_missing_file_is_refused(kind: str, tmp_path: Path) -> None:
    path = WRITERS[kind](tmp_path)
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert "found no such file" in refused(kind, path)


def refused(kind: str, path: Path) -> str:
    with pytest.raises(ValueError, match=r".") as message:
        read(kind, path)
    assert str(path) in str(message.value)
    assert "\n" not in str(message.value)
    return str(message.value)


@PICKLED
@pytest.mark.parametrize("how", ["pickle", "joblib", "object array", "npy", "torch", "old torch"])
def test_a_pickle_runs_nothing(kind: str, how: str, tmp_path: Path) -> None:
    """Whatever a file is called and however it is packed."""
    victim = tmp_path / "victim"
    path = the_file(WRITERS[kind](tmp_path))
    content = {"poses": touching(victim), 1: {"pose": touching(victim)}}
    if how == "pickle":
        path.write_bytes(pickle.dumps(content))
    elif how == "joblib":
        made.dump_joblib(content, path, compress=True)
    elif how == "object array":
        made.dump_joblib({"poses": np.array([touching(victim)], dtype=object)}, path)
    elif how == "npy":
        with path.open("wb") as stream:
            np.save(stream, np.array(content, dtype=object), allow_pickle=True)
    else:
        torch.save(content, path, _use_new_zipfile_serialization=how == "torch")
    message = refused(kind, path)
    assert "it names" in message
    assert "touch" in message or "Path" in message or "getattr" in message
    assert not victim.exists()
    pickle.loads(pickle.dumps(touching(victim)))
    assert victim.exists()  # it would have


@PICKLED
def test_a_storage_inside_a_pickle_runs_nothing(kind: str, tmp_path: Path) -> None:
    """torch keeps a tensor's numbers in a pickle of their own, which is refused alike."""
    victim = tmp_path / "victim"
    inner = io.BytesIO()
    torch.save(touching(victim), inner, _use_new_zipfile_serialization=False)

    class Storage:
        def __reduce__(self) -> tuple[Any, ...]:
            return (torch.storage._load_from_bytes, (inner.getvalue(),))

    path = the_file(WRITERS[kind](tmp_path))
    path.write_bytes(pickle.dumps({"poses": Storage()}))
    refused(kind, path)
    assert not victim.exists()


def test_matrices_that_are_no_rotations_are_refused(tmp_path: Path) -> None:
    mirrored = made.PERFORMER.R * np.array([1, 1, -1])
    for wrong in (mirrored, 2 * made.PERFORMER.R, np.full((made.FRAMES, 24, 3, 3), np.inf)):
        path = made.write_hmmr(tmp_path, poses=wrong)
        with pytest.raises(ValueError, match="expected rotation matrices"):
            read("hmmr", path)


def test_people_who_are_not_seen_in_a_frame_are_left_out_there(tmp_path: Path) -> None:
    path = made.write_phalp(tmp_path, tracked_time=[0, 3])  # the performer is lost throughout
    far = PerformerBoxes(wanted().frames, made.OTHER.box_px[1:-1], made.SIZE)
    np.testing.assert_allclose(read("hmr2", path, far), expected("hmr2", made.OTHER), atol=1e-5)


def test_tracks_of_tram_without_places_are_chosen_by_length(tmp_path: Path) -> None:
    path = made.write_tram(tmp_path, img_focal=None)
    np.testing.assert_allclose(read("tram", path), expected("tram", made.OTHER), atol=1e-5)
    np.testing.assert_allclose(read("tram", path / "hps_track_1.npy"), expected("tram"), atol=1e-5)


def test_sam_3d_bodys_points_are_called_as_here() -> None:
    """Thirteen are SMPL's joints, the others SMPL+H's fingers or points of their own."""
    assert len(set(NAMES)) == 70
    fingers = set(SMPLH_JOINTS) - set(SMPL_JOINTS)
    assert fingers <= set(NAMES)
    # MHR's order: a finger's tip first, its knuckle at the palm last
    assert NAMES[25:29] == ("right_index_tip", "right_index3", "right_index2", "right_index1")
    assert (NAMES[15], NAMES[20], NAMES[21], NAMES[42]) == (
        *("left_big_toe", "right_heel", "right_thumb_tip", "left_thumb_tip"),
    )


def test_a_frame_without_anybody_is_nan(tmp_path: Path) -> None:
    path = made.write_sam3d_body(tmp_path)
    content = json.loads(path.read_text())
    content[2] = []
    path.write_text(json.dumps(content))
    assert np.isnan(read("sam3d_body", path)[1]).all()
    assert np.isfinite(read("sam3d_body", path)[[0, 2, 3]]).any(axis=(1, 2)).all()


KIND, LAYOUT = "sam3d_body", "wholebody133"
POINTS = np.random.default_rng(0).integers(10, 350, size=(3, 2, 70, 2)).astype(float)
FORMS = {
    "lists of people": lambda t, people: people,
    "with frames": lambda t, people: {"frame": t + 5, "people": people},
    "one person": lambda t, people: people[0],
}


def write(folder: Path, form: str, name: str = "sam3d.json", **changes: Any) -> Path:
    content = [
        FORMS[form](t, [{"pred_keypoints_2d": p.tolist()} | changes for p in POINTS[t]])
        for t in range(len(POINTS))
    ]
    path = folder / name
    packed = pickle.dumps(content) if name.endswith("pkl") else json.dumps(content).encode()
    path.write_bytes(packed)
    return path


@pytest.mark.parametrize("form", FORMS)
def test_body_feet_and_hands_are_read(form: str, tmp_path: Path) -> None:
    path = write(tmp_path, form)
    assert format_and_layout(path, None, None) == (KIND, LAYOUT)
    detected = read_keypoints(path, KIND, LAYOUT)
    assert detected.frames.tolist() == ([5, 6, 7] if form == "with frames" else [0, 1, 2])
    names = layout_names(LAYOUT)
    roots = {f"{side}_hand_root": f"{side}_wrist" for side in ("left", "right")}
    for t, people in enumerate(detected.people):
        assert len(people) == (1 if form == "one person" else 2)
        for person, points in zip(people, POINTS[t], strict=False):
            known = np.flatnonzero(person[:, 2])
            assert set(known) == {*range(23), *range(91, 133)}  # all but the face
            for column in known:
                place = NAMES.index(roots.get(names[column], names[column]))
                np.testing.assert_array_equal(person[column], [*points[place], 1.0])
    assert set(np.ravel(hand_columns(LAYOUT))) <= set(known)


def test_a_pickle_is_read_where_the_format_is_named(tmp_path: Path) -> None:
    path = write(tmp_path, "lists of people", "sam3d.pkl")
    assert format_and_layout(path, KIND, None) == (KIND, LAYOUT)
    assert len(read_keypoints(path, KIND, LAYOUT).people) == 3


@pytest.mark.parametrize("points", [[[0.0, 0.0]] * 69, "text", None])
def test_other_points_are_refused(points: Any, tmp_path: Path) -> None:
    path = write(tmp_path, "lists of people", pred_keypoints_2d=points)
    assert "pred_keypoints_2d: expected numbers (70, 2)" in refused_keypoints(path, KIND, LAYOUT)


@pytest.mark.parametrize("content", ["7", '"text"', "[1, 2]", "{}", "[[]]", "[]", "[{}]"])
def test_a_sam3d_file_of_something_else_is_refused(content: str, tmp_path: Path) -> None:
    path = tmp_path / "sam3d.json"
    path.write_text(content)
    refused_keypoints(path, KIND, LAYOUT)
    refused_keypoints(path, KIND, "coco17")


def content() -> dict[str, Any]:
    shared = np.arange(6.0).reshape(2, 3)
    results: defaultdict[int, dict[str, Any]] = defaultdict(dict)
    results[3] = {"x": shared, "again": [shared, shared.T]}
    return {
        "results": results,
        "fortran": np.asfortranarray(np.arange(12).reshape(3, 4)),
        "big end first": np.arange(5, dtype=">f4"),
        "objects": np.array([{"y": np.ones(2)}, None], dtype=object),
        "names": np.array(["left", "right"]),
        "flags": np.array([True, False]),
        "empty": np.zeros((0, 3)),
        "single": np.array(4.0),
        "number": np.float32(2.5),
        "tensor": torch.arange(12.0).view(3, 4)[1:, ::2],
        "ordered": OrderedDict(a=(1, 2.5, "b", None, True)),
        ("v", 1): np.ones(3, np.float32),
    }


def check(result: Any) -> None:
    expected = content()
    assert set(result) == set(expected)
    np.testing.assert_array_equal(result["results"][3]["again"][1], expected["results"][3]["x"].T)
    for name in ("fortran", "big end first", "names", "flags", "empty", "single", ("v", 1)):
        np.testing.assert_array_equal(result[name], expected[name])
    np.testing.assert_array_equal(result["tensor"], expected["tensor"].numpy())
    np.testing.assert_array_equal(result["objects"][0]["y"], np.ones(2))
    assert result["number"] == 2.5
    assert result["ordered"]["a"] == [1, 2.5, "b", None, True]


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_every_protocol(protocol: int, tmp_path: Path) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps(content(), protocol=protocol))
    check(read_results(path))


@pytest.mark.parametrize("compress", [False, True])
def test_joblib(compress: bool, tmp_path: Path) -> None:
    check(read_results(made.dump_joblib(content(), tmp_path / "a.pkl", compress=compress)))


def test_npy_of_objects_and_of_numbers(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array(content(), dtype=object), allow_pickle=True)
    check(read_results(tmp_path / "a.npy"))
    np.save(tmp_path / "b.npy", np.eye(3))
    np.testing.assert_array_equal(read_results(tmp_path / "b.npy"), np.eye(3))


@pytest.mark.parametrize("new", [False, True])
def test_torch_files_of_both_kinds(new: bool, tmp_path: Path) -> None:
    torch.save({"a": {"b": torch.eye(3)}}, tmp_path / "a.pt", _use_new_zipfile_serialization=new)
    np.testing.assert_array_equal(read_results(tmp_path / "a.pt")["a"]["b"], np.eye(3))


RECONSTRUCT, SCALAR = np.empty(0).__reduce__()[0], np.float64(0).__reduce__()[0]
EMPTY = (np.ndarray, (0,), b"b")
F8, OBJECT = np.dtype("f8"), np.dtype("O")


@pytest.mark.parametrize(
    "crafted",
    [
        Reduced(np.ndarray, ((5,),)),
        Reduced(RECONSTRUCT, EMPTY, (1, (5,), F8, False, b"\0" * 8)),
        Reduced(RECONSTRUCT, EMPTY, (1, (-1,), F8, False, b"\0" * 8)),
        Reduced(RECONSTRUCT, EMPTY, (1, (2**62, 4), F8, False, b"")),
        Reduced(RECONSTRUCT, EMPTY, (1, (1,), OBJECT, False, b"\x41" * 8)),
        Reduced(RECONSTRUCT, EMPTY, (1, (3,), OBJECT, False, [1])),
        Reduced(RECONSTRUCT, EMPTY, (1, "text", F8, False, b"")),
        Reduced(SCALAR, (OBJECT, b"\x41" * 8)),
        Reduced(SCALAR, (F8, b"\0")),
        Reduced(np.dtype, ("f8", False, True), (3, "|", None, ("a",), {"a": (F8, 0)}, 8, 1, 0)),
        Reduced(np.dtype, ([("a", "f8")],)),
        Reduced(OrderedDict, (), {"keys": 1}),
    ],
)
def test_crafted_arrays_are_refused(crafted: Reduced, tmp_path: Path) -> None:
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({"a": crafted, "b": [crafted]}))
    with pytest.raises(ValueError, match="refused, it cannot be read safely"):
        read_results(path)


def test_a_tensor_may_not_reach_beyond_its_numbers() -> None:
    whole = torch.arange(4.0)
    numbers = torch.storage.TypedStorage(
        wrap_storage=whole.untyped_storage(), dtype=whole.dtype, _internal=True
    )
    np.testing.assert_array_equal(unpickle.tensor(numbers, 1, (3,), (1,)), [1, 2, 3])
    for offset, size, stride in ((2, (3,), (1,)), (0, (2, 3), (3, 1)), (-1, (1,), (1,))):
        with pytest.raises(pickle.UnpicklingError, match="it contains a"):
            unpickle.tensor(numbers, offset, size, stride)
