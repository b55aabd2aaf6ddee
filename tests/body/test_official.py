"""Official files: each format is written here by the test, then read back and used."""

import os
import pickle
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse
import torch

from imocap_core.body import keypoints_with_jacobian, load_body, load_free_body, model_files
from imocap_core.body.official import as_array
from imocap_core.conventions import SMPL_PARENTS, SMPLH_PARENTS
from imocap_core.rotations import exp
from imocap_core.unpickle import InertObject
from tests.body.bodies import made_body, rodrigues_naive, skin_naive
from tests.reduced import Reduced

SMPLX_PARENTS = (
    *SMPL_PARENTS[:22],
    *(15, 15, 15),
    *(parent if parent < 22 else parent + 3 for parent in SMPLH_PARENTS[22:]),
)
TREES = {"smpl": SMPL_PARENTS, "smplh": SMPLH_PARENTS, "smplx": SMPLX_PARENTS}
SHAPES = {"smpl": 10, "smplh": 16, "smplx": 20}


def official_arrays(kind: str) -> dict[str, Any]:
    """A made-up body in the format of an official file."""
    rng = np.random.default_rng(7)
    parents = TREES[kind]
    made = made_body(rng, 80, parents, SHAPES[kind], pose_blend=True)
    tree = np.array([parents, range(len(parents))], dtype=np.int64).astype(np.uint32)
    arrays: dict[str, Any] = {
        "v_template": made.v_template.numpy(),
        "shapedirs": made.shapedirs.numpy(),
        "posedirs": made.posedirs.numpy(),  # type: ignore[union-attr]
        "J_regressor": made.J_regressor.numpy(),
        "weights": made.weights.numpy(),
        "kintree_table": tree,  # the root's parent is 2^32 - 1, as in the originals
        "f": made.faces.numpy().astype(np.uint32),
    }
    if kind != "smpl":
        for side in "lr":
            arrays[f"hands_mean{side}"] = rng.normal(size=45)
            arrays[f"hands_components{side}"] = rng.normal(size=(45, 45))
    if kind == "smplx":
        arrays["lmk_faces_idx"] = rng.integers(0, 50, 51)
        arrays["lmk_bary_coords"] = rng.dirichlet(np.ones(3), 51)
    return arrays


@pytest.fixture
def chumpy_like(monkeypatch: pytest.MonkeyPatch) -> type:
    """A class that pickles as chumpy.ch.Ch does; chumpy itself is never needed."""
    module = types.ModuleType("chumpy.ch")

    class Ch:
        def __init__(self, x: np.ndarray) -> None:
            self.x = x

    Ch.__module__, Ch.__qualname__ = "chumpy.ch", "Ch"
    module.Ch = Ch  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "chumpy", types.ModuleType("chumpy"))
    monkeypatch.setitem(sys.modules, "chumpy.ch", module)
    return Ch


def write_pickle(path: Path, content: object, protocol: int = 2) -> Path:
    path.write_bytes(pickle.dumps(content, protocol=protocol))
    return path


@pytest.mark.parametrize("kind", ["smpl", "smplh", "smplx"])
def test_agrees_with_the_published_formulas(kind: str, tmp_path: Path) -> None:
    """Hands, jaw, eyes, expression and pose blend shapes included."""
    arrays = official_arrays(kind)
    np.savez(tmp_path / f"{kind}_neutral.npz", **arrays)
    rng = np.random.default_rng(8)
    joints = len(TREES[kind])
    theta, transl = rng.normal(size=(joints, 3)), rng.normal(size=3)
    coefficients = rng.normal(size=SHAPES[kind])
    rotations = np.stack([rodrigues_naive(a) for a in theta])
    for dtype, bound_m in ((torch.float64, 1e-10), (torch.float32, 1e-5)):
        model = load_body(tmp_path / f"{kind}_neutral.npz", dtype=dtype)
        betas = torch.as_tensor(coefficients[: model.num_betas], dtype=dtype)
        rest = torch.as_tensor(coefficients[model.num_betas :], dtype=dtype)
        shaped = model.shape(betas, rest if len(rest) else None)
        posed = shaped.pose(
            exp(torch.as_tensor(theta).to(dtype)), torch.as_tensor(transl).to(dtype)
        )
        vertices, places = skin_naive(model, coefficients, rotations, transl)
        assert np.abs(posed.mesh().vertices.numpy() - vertices).max() < bound_m
        assert np.abs(posed.joints.numpy() - places).max() < bound_m


@pytest.mark.parametrize("protocol", [0, 2, 4])
@pytest.mark.parametrize("kind", ["smpl", "smplh", "smplx"])
def test_pickle_and_npz_are_the_same_model(kind, protocol, tmp_path, chumpy_like, monkeypatch):
    arrays = official_arrays(kind)
    np.savez(tmp_path / "a.npz", **arrays)
    pickled = dict(arrays)
    pickled["shapedirs"] = chumpy_like(arrays["shapedirs"])
    pickled["J_regressor"] = scipy.sparse.csc_matrix(arrays["J_regressor"])
    pickled["bs_style"] = "lbs"
    first = load_body(tmp_path / "a.npz")
    path = write_pickle(tmp_path / "a.pkl", pickled, protocol)
    for name in ("chumpy", "chumpy.ch"):
        monkeypatch.delitem(sys.modules, name)
    second = load_body(path)
    assert first.digest == second.digest
    for name in ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "faces"):
        assert torch.equal(getattr(first, name), getattr(second, name)), name
    assert first.parents == second.parents == TREES[kind]
    assert first.landmarks == second.landmarks


def test_derivatives_hold_with_expression_and_pose_blend_shapes(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", **official_arrays("smplx"))
    model = load_body(tmp_path / "x.npz")
    points = model.points("smpl24")
    rng = np.random.default_rng(9)
    rotations = exp(torch.as_tensor(rng.normal(size=(55, 3))))
    transl = torch.as_tensor(rng.normal(size=3))
    coefficients = torch.as_tensor(rng.normal(size=20))

    def place(values: torch.Tensor) -> torch.Tensor:
        shaped = model.shape(values[:10], values[10:])
        return shaped.pose(rotations, transl).keypoints(points)

    shaped = model.shape(coefficients[:10], coefficients[10:])
    xyz, _, d_shape = keypoints_with_jacobian(shaped, points, rotations, transl)
    torch.testing.assert_close(xyz, place(coefficients))
    expected = torch.autograd.functional.jacobian(place, coefficients)
    torch.testing.assert_close(d_shape, expected)


def test_faces_come_with_their_landmarks(tmp_path: Path) -> None:
    arrays = official_arrays("smplx")
    np.savez(tmp_path / "x.npz", **arrays)
    model = load_body(tmp_path / "x.npz")
    points = model.points("wholebody133")
    assert {f"face{i}" for i in range(17, 68)} <= set(points.names)
    assert points.columns[points.names.index("face17")] == 23 + 17


def test_a_pickle_that_would_run_something_is_refused(tmp_path: Path) -> None:
    path = write_pickle(tmp_path / "evil.pkl", {"v_template": Reduced(os.system, ("exit 1",))})
    with pytest.raises(ValueError, match=r"evil\.pkl: refused.*system"):
        load_body(path)


@pytest.mark.parametrize("allowed", [(eval, ("1",)), (getattr, (1, "real")), (type, ("x", (), {}))])
def test_nothing_but_arrays_is_ever_called(tmp_path: Path, allowed: tuple[Any, Any]) -> None:
    with pytest.raises(ValueError, match="refused"):
        load_body(write_pickle(tmp_path / "sly.pkl", {"f": Reduced(*allowed)}))


@pytest.mark.usefixtures("unchecked_shapes")
def test_bad_files_are_named_with_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such body model file"):
        load_body(tmp_path / "none.npz")
    for content in (b"PK nonsense", b""):
        (tmp_path / "broken.npz").write_bytes(content)
        with pytest.raises(ValueError, match=r"broken\.npz: refused"):
            load_body(tmp_path / "broken.npz")
    (tmp_path / "broken.pkl").write_bytes(b"\x80\x02nonsense")
    with pytest.raises(ValueError, match=r"broken\.pkl: refused"):
        load_body(tmp_path / "broken.pkl")
    arrays = official_arrays("smpl")
    del arrays["weights"]
    np.savez(tmp_path / "partial.npz", **arrays)
    with pytest.raises(ValueError, match=r"missing: \['weights'\]"):
        load_body(tmp_path / "partial.npz")
    arrays = official_arrays("smpl") | {"weights": np.ones((3, 24))}
    np.savez(tmp_path / "unfit.npz", **arrays)
    with pytest.raises(ValueError, match="unfit"):
        load_body(tmp_path / "unfit.npz")


def test_landmarks_found_by_geometry_are_where_the_free_bodys_own_are(tmp_path: Path) -> None:
    """The free body, written in SMPL's format, keeps its points within 3 cm (1 cm for the nose)."""
    free = load_free_body()
    np.savez(
        tmp_path / "SMPL_FREE.npz",
        v_template=free.v_template.numpy(),
        shapedirs=free.shapedirs.numpy(),
        J_regressor=free.J_regressor.numpy(),
        weights=free.weights.numpy(),
        kintree_table=np.array([free.parents, range(24)]),
        f=free.faces.numpy(),
    )
    read = load_body(tmp_path / "SMPL_FREE.npz")
    for layout in ("body25", "body25b"):
        mine, theirs = free.points(layout), read.points(layout)
        assert theirs.names == mine.names
        rest = torch.eye(3, dtype=torch.float64).expand(24, 3, 3), torch.zeros(3).double()
        shape = torch.zeros(10).double()
        apart = (
            free.shape(shape).pose(*rest).keypoints(mine)
            - read.shape(shape).pose(*rest).keypoints(theirs)
        ).norm(dim=-1)
        assert apart.max() < 0.03
        assert apart[mine.names.index("nose")] < 0.01


def test_official_files_are_known_by_their_names(tmp_path: Path) -> None:
    assert not any(model_files(None).values())
    names = {
        "SMPL": "basicModel_f_lbs_10_207_0_v1.0.0.pkl",
        "SMPL+H": "smplh/male/model.npz",
        "SMPL-X": "smplx/SMPLX_NEUTRAL.npz",
    }
    for name in (*names.values(), "notes_on_smpl_models.npz"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert model_files(tmp_path) == {key: [tmp_path / name] for key, name in names.items()}


def record(**state: object) -> InertObject:
    """What the restricted reader makes of an object of a library it does not import."""
    inert = InertObject()
    inert.restore(state)
    return inert


def test_arrays_are_taken_out_of_every_kind_of_record() -> None:
    values = np.arange(12.0).reshape(3, 4)
    np.testing.assert_array_equal(as_array(record(x=record(x=values))), values)
    chosen = record(a=record(x=values), idxs=np.array([5, 0, 7, 2]), preferred_shape=(2, 2))
    np.testing.assert_array_equal(as_array(chosen), [[5, 0], [7, 2]])
    sparse = scipy.sparse.csc_matrix(values)
    fields = {name: getattr(sparse, name) for name in ("data", "indices", "indptr")}
    np.testing.assert_array_equal(as_array(record(_shape=(3, 4), **fields)), values)
    with pytest.raises(ValueError, match="by columns"):
        as_array(record(_shape=(4, 3), **fields))
    with pytest.raises(ValueError, match=r"\['other'\] holds no array"):
        as_array(record(other=1))
    with pytest.raises(ValueError, match="holds no array"):
        as_array(InertObject("never given a state"))
