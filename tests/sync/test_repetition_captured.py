"""Repetitions in captured motion: walks have them, dances don't, repeated actions are counted."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from imocap_core.params import RepetitionParams
from imocap_core.sync.repetition import Repetitions, find_repetitions
from imocap_core.synthetic.choreography import PhaseSpan, pace

DATA = Path(os.environ.get("IMOCAP_DATA", Path(__file__).parents[3] / "shared" / "data"))
FILE = DATA / "train" / "cmu_train.npz"
FPS = 30.0

pytestmark = pytest.mark.skipif(not FILE.is_file(), reason="needs the training clips (IMOCAP_DATA)")


def _clip(name: str) -> np.ndarray:
    with np.load(FILE) as stored:
        joints = stored[f"clip_{name}"].astype(np.float64)
    relative: np.ndarray = joints - joints[:, :1]
    return relative


def _repetitions(poses: np.ndarray) -> Repetitions:
    return find_repetitions(poses, FPS, RepetitionParams())


@pytest.mark.parametrize(("walk", "strides"), [("06_01", 3), ("12_02", 4), ("12_03", 3)])
def test_strides_of_a_walk_are_counted(walk: str, strides: int) -> None:
    assert len(_repetitions(_clip(walk)).spans) == strides


@pytest.mark.parametrize("dance", ["05_04", "05_06", "05_09", "05_13", "05_20", "13_15"])
def test_nothing_repeats_in_a_dance(dance: str) -> None:
    assert len(_repetitions(_clip(dance)).spans) == 1


@pytest.mark.parametrize("action", ["05_03", "05_15", "02_04", "06_14"])
def test_performances_in_a_row_are_counted_and_cut(action: str) -> None:
    rng = np.random.default_rng(int(action[-2:]))
    once = _clip(action)
    parts, phases = [], []
    for _ in range(3):
        length = round(len(once) * rng.uniform(0.75, 1.35))
        phase = pace(PhaseSpan(length, 0.0, len(once) - 1.0, FPS), rng)
        low = np.minimum(phase.astype(int), len(once) - 2)
        share = (phase - low)[:, None, None]
        parts.append((1 - share) * once[low] + share * once[low + 1])
        phases.append(phase / (len(once) - 1))
    repetitions = _repetitions(np.concatenate(parts))
    assert len(repetitions.spans) == 3, repetitions.status
    phase_of = np.concatenate([phase + k for k, phase in enumerate(phases)])
    cuts = np.array([(phase_of[first], phase_of[stop - 1]) for first, stop in repetitions.spans])
    off = cuts - np.arange(3)[:, None]  # in performances; slow endings are trimmed
    assert np.abs(off[:, 0]).max() < 0.2, off
    assert (off[:, 1] > 0.6).all(), off
    assert (off[:, 1] < 1.2).all(), off
