"""Motions made from key poses: minimum-jerk ways between them, feet and hands held where they are.

Every performance has its own tempo, pauses, delays of arms behind the trunk, sway and side; half of
them are mirror images. Axes of the results: z up, as captured clips.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from lifter import anatomy
from lifter.anatomy import ARMS, MIDDLE, WORLD, Goals, J, Pose, about, from_rotvec, rotvec
from lifter.arms import Draw
from lifter.exercises import RECIPES

RATE_HZ, FRAMES = 30.0, 90
SEGMENTS = 14  # between keys, of a performance
SLOWEST_S, FASTEST_S = 1.6, 0.22  # from key to key
STEP_RISE = 0.12  # of a foot, of its way
SWAY_DEG = {"spine": 1.2, "neck": 2.5, "head": 2.5, "shoulder": 2.0, "elbow": 2.0, "wrist": 4.0,
            "hip": 0.8, "knee": 0.8, "pelvis": 0.8}  # fmt: skip
TURNING = ("roll", "cartwheel", "walk")  # whose last key is the first, once round
MOST_BAD = 0.15  # share of a performance's frames that may be out of range
LATE_S = 0.12
GROUPS = np.zeros(24, int)  # 0 legs and pelvis, 1 trunk and head, 2 and 3 arms
for _name, _k in J.items():
    if any(p in _name for p in ("spine", "neck", "head")):
        GROUPS[_k] = 1
    if any(p in _name for p in ("collar", "shoulder", "elbow", "wrist", "hand")):
        GROUPS[_k] = 2 if _name.startswith("left") else 3


@dataclass(frozen=True)
class MadePerformances:
    """N performances of T frames: theta (N, T, 24, 3) axis-angle, trans (N, T, 3) metres; z up."""

    theta: np.ndarray
    trans: np.ndarray


def performances(
    count: int, seed: int = 0, frames: int = FRAMES, rate_hz: float = RATE_HZ
) -> dict[str, MadePerformances]:
    """About `count` performances, by recipe, in proportion to their shares."""
    total = sum(share for _, share in RECIPES.values())
    made = {}
    for row, (name, (_, share)) in enumerate(RECIPES.items()):
        rng = np.random.default_rng([seed, row])
        parts = []
        wanted = round(count * share / total)
        while sum(len(p.theta) for p in parts) < wanted:
            parts.append(perform(name, min(200, 2 * wanted), rng, frames, rate_hz))
        made[name] = MadePerformances(
            np.concatenate([p.theta for p in parts])[:wanted],
            np.concatenate([p.trans for p in parts])[:wanted],
        )
    return made


def perform(
    name: str, count: int, rng: np.random.Generator, frames: int = FRAMES, rate_hz: float = RATE_HZ
) -> MadePerformances:
    """The plausible ones of `count` performances of a recipe."""
    d = Draw(rng, count)
    keys = RECIPES[name][0](d)
    poses = [anatomy.pose_of(k) for k in keys]
    good = np.all([anatomy.plausible(p) for p in poses], axis=0)
    keys = [k.rows(good) for k in keys]
    poses = [Pose(p.R_local[good], p.root[good]) for p in poses]
    d = Draw(rng, int(good.sum()))
    before, after, way = _timing(d, len(keys), np.arange(frames) / rate_hz, turning=name in TURNING)
    pose = _between(d, keys, poses, before, after, way, np.arange(frames) / rate_hz)
    bad = ~anatomy.plausible(pose).reshape(d.count, frames)
    keep = bad.mean(1) < MOST_BAD
    up = about("x", np.array(90.0))
    R = pose.R_local.reshape(d.count, frames, 24, 3, 3)[keep]
    R[:, :, 0] = up @ R[:, :, 0]
    theta = rotvec(R)
    trans = pose.root.reshape(d.count, frames, 3)[keep] @ up.T
    flip = rng.random(len(theta)) < 0.5
    theta[flip] = mirror_image(theta[flip])
    trans[flip] *= (-1.0, 1.0, 1.0)
    return MadePerformances(theta.astype(np.float32), trans.astype(np.float32))


def mirror_image(theta: np.ndarray) -> np.ndarray:
    """Motions (..., 24, 3) in a mirror, left and right swapped."""
    side = {"left": "right", "right": "left"}
    twins = []
    for name in J:
        first, _, rest = name.partition("_")
        twins.append(J[f"{side[first]}_{rest}"] if first in side else J[name])
    return theta[..., twins, :] * (1.0, -1.0, -1.0)


def _timing(
    d: Draw, keys: int, time_s: np.ndarray, turning: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Keys before and after each frame (N, T), and the share of the way (N, T, 4) of each group."""
    there = list(range(keys)) if turning else [*range(keys), *range(keys - 2, 0, -1)]
    order = np.array((there * SEGMENTS)[: SEGMENTS + 1 + keys])
    if turning:
        order = np.array([k % (keys - 1) for k in range(SEGMENTS + 1 + keys)])
    first = d.rng.integers(max(1, keys - 1), size=d.count)
    index = order[first[:, None] + np.arange(SEGMENTS + 1)]
    tempo = np.log(d.u(0, 1, 1) * (SLOWEST_S - FASTEST_S) + FASTEST_S) + d.n(0, 0.25, SEGMENTS)
    duration = np.exp(tempo) * (d.rng.random((d.count, SEGMENTS)) * 0.3 + 0.85)
    pause = np.where(d.rng.random((d.count, SEGMENTS)) < 0.3, d.u(0, 0.6, SEGMENTS), 0.0)
    ends = (duration + pause).cumsum(1)
    time = time_s + d.u(0, 0.5, 1) * duration[:, :1]
    segment = (time[:, :, None] >= ends[:, None]).sum(-1).clip(0, SEGMENTS - 1)
    rows = np.arange(d.count)[:, None]
    began = ends[rows, segment] - (duration + pause)[rows, segment]
    late = np.abs(d.n(0, LATE_S, 4)) * (0, 0.5, 1, 1)
    late *= np.minimum(1.0, duration.mean(1, keepdims=True))
    share = (time - began)[..., None] / duration[rows, segment][..., None]
    span = 1 + late / duration.mean(1, keepdims=True)
    share = np.clip(share * span[:, None] - (span - 1)[:, None], 0, 1)
    smooth = share**3 * (10 - 15 * share + 6 * share**2)
    return index[rows, segment], index[rows, segment + 1], smooth


def _between(
    d: Draw, keys: list[Goals], poses: list[Pose], before: np.ndarray, after: np.ndarray,
    way: np.ndarray, time_s: np.ndarray,
) -> Pose:  # fmt: skip
    rows = np.broadcast_to(np.arange(d.count)[:, None], before.shape)
    R_keys, roots = np.stack([p.R_local for p in poses]), np.stack([p.root for p in poses])
    share = way[..., GROUPS]
    a, b = R_keys[before, rows], R_keys[after, rows]
    turn = rotvec(a.swapaxes(-1, -2) @ b) * share[..., None]
    R = (a @ from_rotvec(turn) @ from_rotvec(_sway(d, time_s))).reshape(-1, 24, 3, 3)
    legs = way[..., 0, None]
    root = ((1 - legs) * roots[before, rows] + legs * roots[after, rows]).reshape(-1, 3)
    goals, both, hands, object_ = _goals_between(keys, before, after, way[..., 0])
    anatomy.stand_on(goals.feet, goals, R, root, both)
    _hold_hands(poses, keys, R, root, (before, after, rows, way), hands, object_)
    free = ~goals.planted
    lowest = (Pose(R, root).posed()[1][..., 1] - anatomy.THICKNESS_M).min(1)
    lift = np.nan_to_num(goals.height)
    root[:, 1] -= np.where(free, lowest - lift, 0.0)
    return Pose(R, root)


def _sway(d: Draw, time_s: np.ndarray) -> np.ndarray:
    """(N, T, 24, 3) radians: small slow turns."""
    size = np.array([next((v for p, v in SWAY_DEG.items() if p in n), 0.0) for n in J])
    time = time_s[None, :, None, None]
    rate, phase = d.u(0.15, 1.2, 1, 24, 3), d.u(0, 2 * np.pi, 1, 24, 3)
    strength = np.radians(size)[None, None, :, None] * d.n(0, 1, 1, 24, 3)
    return strength * np.sin(2 * np.pi * rate * time + phase)


def _goals_between(
    keys: list[Goals], before: np.ndarray, after: np.ndarray, way: np.ndarray
) -> tuple[Goals, np.ndarray, np.ndarray, np.ndarray]:
    """Goals of every frame in a row; where feet are planted at both keys, and hands are on the
    floor or a thing, or on one object, at both."""
    rows = np.broadcast_to(np.arange(len(before))[:, None], before.shape)
    merged = {}
    for field in fields(Goals):
        x = np.stack([getattr(k, field.name) for k in keys])
        a, b = x[before, rows], x[after, rows]
        if x.dtype == bool:
            merged[field.name] = a | b
        else:
            w = way.reshape(*way.shape, *[1] * (a.ndim - 2))
            merged[field.name] = (1 - w) * np.nan_to_num(a) + w * np.nan_to_num(b)
    planted = np.stack([k.planted for k in keys])
    both = planted[before, rows] & planted[after, rows]
    feet = np.stack([k.feet for k in keys])
    far = np.linalg.norm(feet[after, rows] - feet[before, rows], axis=-1)
    merged["feet"] = merged["feet"].copy()
    merged["feet"][..., 1] += STEP_RISE * far * np.sin(np.pi * way)[..., None]
    axes = np.stack([k.axes for k in keys])[:, :, 0]
    same = [(axes[before, rows] == kind) & (axes[after, rows] == kind) for kind in (WORLD, MIDDLE)]
    flat = {k: x.reshape(-1, *x.shape[2:]) for k, x in merged.items()}
    return Goals(**flat), both.ravel(), same[0].ravel(), same[1].ravel()


def _hold_hands(
    poses: list[Pose], keys: list[Goals], R: np.ndarray, root: np.ndarray,
    timing: tuple[np.ndarray, ...], on_floor: np.ndarray, on_object: np.ndarray,
) -> None:  # fmt: skip
    """Hands that stay where they are planted, or at their distance on one object (in R)."""
    before, after, rows, way = timing
    wrists = np.stack([p.posed()[1][:, [arm[2] for arm in ARMS]] for p in poses])
    a, b = wrists[before, rows], wrists[after, rows]
    w = way[..., 0, None, None]
    planted = ((1 - w) * a + w * b).reshape(-1, 2, 3)
    apart = [np.linalg.norm(x[:, :, 0] - x[:, :, 1], axis=-1) for x in (a, b)]
    distance = ((1 - w[..., 0, 0]) * apart[0] + w[..., 0, 0] * apart[1]).reshape(-1, 1)
    now = Pose(R, root).posed()[1][:, [arm[2] for arm in ARMS]]
    middle = now.mean(1)
    half = anatomy.unit(now[:, 0] - now[:, 1]) * distance / 2
    on_thing = np.stack([middle + half, middle - half], 1)
    held = on_floor | on_object
    if not held.any():
        return
    place = np.where(on_floor[:, None, None], planted, on_thing)[held]
    part, part_root = R[held], root[held]
    for side in (0, 1):
        elbow = np.full((len(part), 3), np.nan)
        elbow = _elbow_now(part, part_root, side)
        anatomy.reach(part, part_root, side, place[:, side], elbow, np.zeros(len(part)))
    R[held] = part


def _elbow_now(R: np.ndarray, root: np.ndarray, side: int) -> np.ndarray:
    """Where an elbow points to, in the chest's axes."""
    R_world, xyz = Pose(R, root).posed()
    shoulder, elbow, wrist = (xyz[:, k] for k in ARMS[side])
    straight = anatomy.unit(wrist - shoulder)
    out = elbow - shoulder
    out = out - (out * straight).sum(-1, keepdims=True) * straight
    local = anatomy.apply(R_world[:, J["spine3"]].swapaxes(-1, -2), out)
    bent = np.linalg.norm(local, axis=-1, keepdims=True)
    return np.where(bent > 0.02, local / np.maximum(bent, 1e-9), np.nan)
