"""The benchmark of compare's permutation test, on made takes."""

import json
from pathlib import Path

import numpy as np

from benchmarks.chance.report import least_probability
from benchmarks.chance.takes import CapturedTake, takes_of
from imocap_core.compare.chance import LIKELY

NAMES = tuple(
    f"{side}_{name}"
    for side in "lr"
    for name in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
)


def takes(file: Path, count: int, lift_rad: float, rng: np.random.Generator) -> list[CapturedTake]:
    """Arms raised sideways, of a size and speed of their own, read back from a file."""
    of_all = {}
    for k in range(count):
        T = int(rng.integers(36, 46))
        t = np.linspace(0, np.pi, T)
        raised = (1.2 + lift_rad + rng.normal(0, 0.05)) * np.sin(t)
        rows = []
        for x, sign in ((0.1, 1.0), (-0.1, -1.0)):
            arm = np.stack([sign * np.sin(raised), 0 * t, -np.cos(raised)], axis=-1)
            hip, shoulder = np.array([x, 0, 1.0]), np.array([2 * x, 0, 1.5])
            legs = [np.tile(hip - [0, 0, down], (T, 1)) for down in (0.0, 0.5, 1.0)]
            rows += [*legs, *(shoulder + far * arm for far in (0.0, 0.3, 0.6))]
        of_all[f"trial_{k:02d}"] = np.stack(rows, axis=1)
    meta = np.array(json.dumps({"up": "z"}))
    about = {"common14": np.array(NAMES), "common14_idx": np.arange(len(NAMES)), "fps": 30.0}
    np.savez(file, **about, trial_ids=np.arange(count), meta=meta, **of_all)
    return takes_of(file)


def test_lifted_arms_are_told_from_others_and_equal_ones_are_not(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    ours = takes(tmp_path / "a.npz", 8, 0.0, rng)
    theirs = takes(tmp_path / "b.npz", 4, 0.6, rng)
    raised = ours[0].angles_deg(ours[0].joints)["l_shoulder"]
    assert raised.max() > 60
    assert np.abs(raised[[0, -1]]).max() < 1e-6
    assert least_probability(ours[:4], theirs, rng) <= LIKELY
    assert least_probability(ours[:4], ours[4:], rng) > LIKELY
