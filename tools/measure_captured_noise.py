"""Captured truth's own accelerations: ``python tools/measure_captured_noise.py DATA/trials``.

A row for each action, over all its trials: the mean acceleration of twelve joints relative to the
hips' middle; how far it changes by Gaussians of half, 0.7 and one frame in time; the share of its
energy above 7.5 Hz; the median speed of planted ankles.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d

from imocap_core.metrics.trajectory import foot_contacts, planted_foot_speed_mm_s

FRAMES = (0.5, 0.7, 1.0)  # standard deviations of the Gaussians
FAST_HZ = 7.5
HEAD = ("neck", "head")


def trials(file: Path) -> Iterator[tuple[np.ndarray, list[str], float]]:
    """Joints (T, 14, 3) of every trial, metres; their names; frames a second."""
    with np.load(file) as stored:
        rows, names = stored["common14_idx"], [str(name) for name in stored["common14"]]
        for trial in sorted(set(stored.files) - {"trial_ids"}):
            if trial.startswith("trial_"):
                yield stored[trial][:, rows].astype(float), names, float(stored["fps"])


def accelerations(xyz: np.ndarray, fps: float) -> np.ndarray:
    """Second differences times fps squared, (T - 2, J, 3)."""
    bends: np.ndarray = np.diff(xyz, 2, axis=0) * fps**2
    return bends


def fast_share(bends: np.ndarray, fps: float) -> float:
    """Share of the energy of accelerations above `FAST_HZ`, by a Hann window."""
    spectrum = np.abs(np.fft.rfft(bends * np.hanning(len(bends))[:, None, None], axis=0)) ** 2
    fast = np.fft.rfftfreq(len(bends), 1 / fps) > FAST_HZ
    return float(spectrum[fast].sum() / spectrum.sum())


def measures(xyz: np.ndarray, names: list[str], fps: float) -> list[float]:
    """The numbers of one trial, in the order of the table's columns."""
    feet = xyz[:, [names.index(f"{side}_ankle") for side in "lr"]]
    hips = xyz[:, [names.index(f"{side}_hip") for side in "lr"]].mean(1)
    limbs = [row for row, name in enumerate(names) if name not in HEAD]
    relative = xyz[:, limbs] - hips[:, None]
    true = accelerations(relative, fps)
    changes = [
        np.linalg.norm(accelerations(gaussian_filter1d(relative, sd, axis=0), fps) - true, axis=-1)
        for sd in FRAMES
    ]
    planted = planted_foot_speed_mm_s(feet, foot_contacts(feet, fps), fps)
    size = float(np.linalg.norm(true, axis=-1).mean())
    return [size, *(float(c.mean()) for c in changes), 100 * fast_share(true, fps), planted]


def main() -> None:
    """Read the actions and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("trials", type=Path, help="folder of npz files with trial_<id> (T, J, 3)")
    arguments = parser.parse_args()
    gaussians = " | ".join(f"{sd:g} frame{'s' * (sd != 1)}" for sd in FRAMES)
    print(f"| action | m/s² | {gaussians} | above {FAST_HZ:g} Hz % | planted ankles mm/s |")
    print("|---|" + "---:|" * (len(FRAMES) + 3))
    rows = []
    for file in sorted(arguments.trials.glob("*.npz")):
        rows.append(np.nanmean([measures(*trial) for trial in trials(file)], axis=0))
        print(f"| {file.stem} | " + " | ".join(_cells(rows[-1])) + " |")
    print("| **mean** | " + " | ".join(_cells(np.mean(rows, axis=0))) + " |")


def _cells(numbers: np.ndarray) -> list[str]:
    return [*(f"{x:.1f}" for x in numbers[:-2]), *(f"{x:.0f}" for x in numbers[-2:])]


if __name__ == "__main__":
    main()
