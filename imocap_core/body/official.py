"""SMPL, SMPL+H and SMPL-X from official files (.pkl or .npz as downloaded).

The arrays in an official model's .pkl file, read without running anything that is in it. SMPL's
.pkl files hold numpy arrays, scipy sparse matrices and chumpy objects. chumpy no longer imports:
its objects and scipy's become inert records (`imocap_core.unpickle`), and their arrays are taken
out of these.

Nothing of these models ships with the package: their licences require each user to register at
smpl.is.tue.mpg.de, mano.is.tue.mpg.de or smpl-x.is.tue.mpg.de.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Int64

from imocap_core.body.free import digest_of
from imocap_core.body.layouts import find_landmarks, static_face_landmarks
from imocap_core.body.model import Model
from imocap_core.conventions import SMPL_JOINTS, SMPLH_JOINTS, SMPLX_JOINTS
from imocap_core.unpickle import UNREADABLE, InertObject, load_pickle


def read_model_pickle(path: Path) -> dict[str, Any]:
    """The dictionary in a model's .pkl file; ValueError when it is damaged or unsafe."""
    try:
        content = load_pickle(path.read_bytes(), inert_modules=("chumpy", "scipy.sparse"))
    except UNREADABLE as error:
        raise ValueError(
            f"{path}: refused, this is not a body model that can be read safely: {error}. "
            "Give the official file as downloaded, or an .npz of its arrays."
        ) from error
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected a dictionary of arrays, got {type(content).__name__}")
    return content


def as_array(value: object) -> np.ndarray:
    """A numpy array from what a model file may hold: array, sparse matrix or chumpy object."""
    if not isinstance(value, InertObject):
        return np.asarray(value)
    state = value.state
    if "indptr" in state and "_shape" in state:
        return _dense(state)
    if "x" in state:  # chumpy.Ch: the array itself
        return as_array(state["x"])
    if "a" in state and "idxs" in state:  # chumpy's Select: some entries of another array
        chosen = as_array(state["a"]).ravel()[as_array(state["idxs"])]
        shape = state.get("preferred_shape")
        return chosen.reshape(shape) if shape is not None else chosen
    raise ValueError(f"an object with fields {sorted(state)} holds no array")


def _dense(state: Mapping[str, Any]) -> np.ndarray:
    """A compressed sparse column matrix, written out."""
    rows, columns = state["_shape"]
    indices, starts = as_array(state["indices"]), as_array(state["indptr"])
    if len(starts) != columns + 1:
        raise ValueError(f"a sparse matrix {rows}x{columns} is not stored by columns")
    dense = np.zeros((rows, columns))
    dense[indices, np.repeat(np.arange(columns), np.diff(starts))] = as_array(state["data"])
    return dense


_KINDS = {24: ("smpl", SMPL_JOINTS), 52: ("smplh", SMPLH_JOINTS), 55: ("smplx", SMPLX_JOINTS)}
_NEEDED = ("v_template", "shapedirs", "J_regressor", "weights", "kintree_table", "f")
_OPTIONAL = ("posedirs", "hands_meanl", "hands_meanr", "hands_componentsl", "hands_componentsr",
             "lmk_faces_idx", "lmk_bary_coords")  # fmt: skip
_SMPLX_SPLIT = {400: 300}  # SMPL-X 1.1: 300 betas, 100 expressions; 1.0 and others: 10 betas first


def load_body(
    path: Path | str, device: torch.device | str = "cpu", dtype: torch.dtype = torch.float64
) -> Model:
    """A body model from a file in SMPL's, SMPL+H's or SMPL-X's format, by its number of joints.

    Raises ValueError, with the file and the field, for files that cannot be read, are unsafe or
    inconsistent.
    """
    path = Path(path)
    arrays = _read(path)
    tree = arrays["kintree_table"].astype(np.int64)
    joints = tree.shape[-1]
    if joints not in _KINDS or tree.shape != (2, joints):
        raise ValueError(
            f"{path}: kintree_table is {tree.shape}, expected (2, 24) for SMPL, (2, 52) for "
            "SMPL+H or (2, 55) for SMPL-X"
        )
    kind, names = _KINDS[joints]
    shapes = arrays["shapedirs"].shape[-1]
    posedirs = arrays.get("posedirs")

    def tensor(array: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(np.ascontiguousarray(array, dtype=np.float64)).to(device, dtype)

    try:
        model = Model(
            name=f"{kind}:{path.stem}",
            joint_names=names,
            parents=_parents(tree),
            v_template=tensor(arrays["v_template"]),
            shapedirs=tensor(arrays["shapedirs"]),
            J_regressor=tensor(arrays["J_regressor"]),
            weights=tensor(arrays["weights"]),
            faces=torch.as_tensor(arrays["f"].astype(np.int64), device=device),
            digest=_digest(arrays),
            num_betas=_betas(kind, shapes),
            posedirs=None if posedirs is None or posedirs.size == 0 else tensor(posedirs),
        )
        return replace(model, landmarks=_landmarks(arrays, names))  # of arrays that fit together
    except (ValueError, IndexError) as error:
        raise ValueError(f"{path}: {error}") from error


def _read(path: Path) -> dict[str, np.ndarray]:
    if not path.is_file():
        raise ValueError(f"{path}: no such body model file")
    if path.suffix not in (".pkl", ".npz"):
        raise ValueError(f"{path}: expected a body model as .pkl or .npz")
    content = read_model_pickle(path) if path.suffix == ".pkl" else _read_npz(path)
    missing = [name for name in _NEEDED if name not in content]
    if missing:
        raise ValueError(f"{path}: not a body model, these arrays are missing: {missing}")
    try:
        return {n: as_array(content[n]) for n in (*_NEEDED, *_OPTIONAL) if n in content}
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _read_npz(path: Path) -> dict[str, Any]:
    if not zipfile.is_zipfile(path):
        raise ValueError(f"{path}: refused, expected an .npz of plain numeric arrays")
    try:
        with np.load(path, allow_pickle=False) as archive:
            names = [n for n in (*_NEEDED, *_OPTIONAL) if n in archive.files]
            return {name: archive[name] for name in names}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(
            f"{path}: refused, expected an .npz of plain numeric arrays: {error}"
        ) from error


def _parents(tree: Int64[np.ndarray, "2 J"]) -> tuple[int, ...]:
    """Row 0 has each joint's parent by its number in row 1; the root's is -1 or 2^32 - 1."""
    place = {int(number): column for column, number in enumerate(tree[1])}
    return (-1, *(place.get(int(number), -1) for number in tree[0, 1:]))


def _betas(kind: str, shapes: int) -> int:
    return _SMPLX_SPLIT.get(shapes, min(10, shapes)) if kind == "smplx" else shapes


def _digest(arrays: dict[str, np.ndarray]) -> str:
    """Of values, not of storage: the same for a .pkl and an .npz of one model."""
    moving = ("v_template", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table")
    return digest_of(np.asarray(arrays[n], dtype=np.float64) for n in moving if n in arrays)


def _landmarks(arrays: dict[str, np.ndarray], names: tuple[str, ...]) -> dict[str, Any]:
    template = np.asarray(arrays["v_template"], dtype=np.float64)
    rest = np.asarray(arrays["J_regressor"], dtype=np.float64) @ template
    weights = np.asarray(arrays["weights"], dtype=np.float64)
    landmarks = find_landmarks(template, weights, rest, names)
    if "lmk_faces_idx" in arrays and "lmk_bary_coords" in arrays:
        landmarks |= static_face_landmarks(
            arrays["f"].astype(np.int64),
            arrays["lmk_faces_idx"].astype(np.int64),
            np.asarray(arrays["lmk_bary_coords"], dtype=np.float64),
        )
    return landmarks


# File names of the downloads; SMPL+H is smplh_male.pkl or smplh/male/model.npz.
_FILES = {
    "SMPL": r"(smpl_|basic_?model_)[^/]*\.(pkl|npz)",
    "SMPL+H": r"smplh(_\w+|/\w+/model)\.(pkl|npz)",
    "SMPL-X": r"smplx(_\w+|/\w+/model)\.(pkl|npz)",
}


def model_files(folder: Path | None) -> dict[str, list[Path]]:
    """The official models' files below `folder`, by model; `load_body` reads them."""
    files = [] if folder is None else sorted(folder.rglob("*"))
    return {
        name: [
            f for f in files if re.fullmatch(f".*/{pattern}", f.resolve().as_posix(), re.IGNORECASE)
        ]
        for name, pattern in _FILES.items()
    }
