"""`imocap benchmark body` and `bones`: speed and fit of the body model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from rich.table import Table

from benchmarks.actions.captured_videos import data_folder
from benchmarks.names import BenchmarkOptions
from benchmarks.tables import table_of_rows
from imocap_core.body import Model, load_free_body
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

# Differences in bone length between measured skeletons and the free body fitted to them.

PRIOR_MM = 1.5  # one standard deviation of one beta costs as much as this error of one bone
STEPS = 30

_LIMBS = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
BONES: tuple[tuple[str, str], ...] = (
    *((f"{side}_{a}", f"{side}_{b}") for side in ("left", "right") for a, b in _LIMBS),
    ("left_hip", "right_hip"),
    ("left_shoulder", "right_shoulder"),
)


@dataclass(frozen=True)
class BoneRow:
    """One skeleton: mean and largest error over its bones, the mean of the unfitted body, and the
    root mean square of the betas."""

    skeleton: str
    mean_mm: float
    largest_mm: float
    unfitted_mm: float
    betas_rms: float


def measure(trials: Path) -> list[BoneRow]:
    """One row for each .npz in a folder of trials (`common14` names the joints of `trial_00`)."""
    model = load_free_body()
    rows = []
    for path in sorted(trials.glob("*.npz")):
        lengths = _measured_lengths(path)
        betas = fit_betas(model, lengths)
        errors = 1e3 * np.abs(bone_lengths(model, betas)[0] - lengths)
        before = 1e3 * np.abs(bone_lengths(model, np.zeros(model.num_betas))[0] - lengths)
        figures = errors.mean(), errors.max(), before.mean(), np.sqrt((betas**2).mean())
        rows.append(BoneRow(path.stem, *(float(figure) for figure in figures)))
    return rows


def _measured_lengths(path: Path) -> Float[np.ndarray, " 10"]:
    """Median bone lengths, metres, over a skeleton's first trial."""
    with np.load(path) as data:
        names = [str(name) for name in data["common14"]]
        xyz = data["trial_00"][:, data["common14_idx"]].astype(np.float64)
    spelled = {"l_": "left_", "r_": "right_"}
    joints = {spelled.get(n[:2], n[:2]) + n[2:]: xyz[:, i] for i, n in enumerate(names)}
    return np.array([np.median(np.linalg.norm(joints[a] - joints[b], axis=1)) for a, b in BONES])


def bone_lengths(
    model: Model, betas: Float[np.ndarray, " B"]
) -> tuple[Float[np.ndarray, " 10"], Float[np.ndarray, "10 B"]]:
    """Bone lengths in metres, and their derivatives by the betas."""
    index = [[model.joint_names.index(name) for name in bone] for bone in BONES]
    first, second = np.array(index).T
    rest, directions = model.joints_template.numpy(), model.joints_shapedirs.numpy()
    across = directions[first] - directions[second]
    vector = rest[first] - rest[second] + across @ betas
    length = np.linalg.norm(vector, axis=1)
    slope = np.einsum("nc,ncb->nb", vector / length[:, None], across)
    return length, slope


def fit_betas(model: Model, lengths: Float[np.ndarray, " 10"]) -> Float[np.ndarray, " B"]:
    """Betas of a body with these bone lengths (metres): Gauss-Newton with a weak prior on the
    mean body."""
    betas = np.zeros(model.num_betas)
    prior = 1e-3 * PRIOR_MM * np.eye(len(betas))
    for _ in range(STEPS):
        fitted, slope = bone_lengths(model, betas)
        system = np.concatenate([slope, prior])
        residual = np.concatenate([lengths - fitted, -prior @ betas])
        betas = betas + np.linalg.lstsq(system, residual, rcond=None)[0]
    return betas


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """The table."""
    return [table_of_rows(measure(data_folder(workspace.root, "trials")))]
