"""Cycle consistency by name, and how far maps are from it."""

import numpy as np
from numpy.typing import NDArray

from imocap_core.sync.blocks import Blocks
from imocap_core.sync.cycle.als import als
from imocap_core.sync.cycle.report import CycleReport
from imocap_core.sync.cycle.row_contrast import contrasted
from imocap_core.sync.cycle.softmap import softmap
from imocap_core.sync.cycle.svt import svt
from imocap_core.sync.warp.positions import median_positions

Array = NDArray[np.float64]
Matrix = NDArray[np.floating]

METHODS = ("softmap", "als", "svt", "none")
AUTO_CANDIDATES = ("softmap", "als")
AUTO_LARGEST = 1600  # frames of all videos up to which `auto` also tries the factorisation


def symmetric_affinity(maps: Matrix, blocks: Blocks) -> Matrix:
    """Directed soft maps or affinities as one symmetric affinity in [0, 1]: how far entries stand
    out in their rows (`contrasted`), both directions averaged."""
    risen = contrasted(maps, blocks)
    return np.asarray(0.5 * (risen + risen.T))


def relax(
    method: str, maps: Matrix, blocks: Blocks, *, rounds: int, rng: np.random.Generator
) -> tuple[Matrix, CycleReport]:
    """Denoise soft maps or affinities (N_a, N_a) by one of METHODS; with fewer than three videos
    there is no cycle."""
    if method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, auto; got {method!r}")
    if method == "none" or len(blocks.lengths) < 3:
        why = (
            "none: switched off" if method == "none" else "none: fewer than three videos, no cycle"
        )
        return maps, CycleReport("none", True, (), why)
    if method == "softmap":
        return softmap(maps, blocks, rounds=rounds)
    affinity = symmetric_affinity(maps, blocks)
    return als(affinity, blocks, rng=rng) if method == "als" else svt(affinity, blocks)


def held_out_residual(
    method: str, maps: Matrix, blocks: Blocks, *, rounds: int, rng: np.random.Generator
) -> float:
    """How well the ways round predict a direct map that the method hasn't seen; mean error as a
    share of the clip.

    Videos are paired off (0-1, 2-3, ...), those direct blocks are emptied, and the blocks the
    method fills in by the other videos are compared, position by position, with what was there.
    """
    hidden = maps.copy()
    M = len(blocks.lengths)
    pairs = [(v, v + 1) for v in range(0, M - 1, 2)]
    for i, j in pairs:
        blocks.block(hidden, i, j)[...] = 0.0
        blocks.block(hidden, j, i)[...] = 0.0
    filled, _ = relax(method, hidden, blocks, rounds=rounds, rng=rng)
    errors = []
    for i, j in pairs:
        direct = median_positions(np.asarray(blocks.block(maps, i, j), dtype=float))
        round_ = median_positions(np.asarray(blocks.block(filled, i, j), dtype=float))
        errors.append(float(np.mean(np.abs(direct - round_))) / blocks.lengths[j])
    return float(np.mean(errors))


def relax_auto(
    maps: Matrix, blocks: Blocks, *, rounds: int, rng: np.random.Generator
) -> tuple[Matrix, CycleReport]:
    """The method with the smallest held-out residual; the factorisation only where it is
    affordable."""
    if len(blocks.lengths) < 3:
        return relax("none", maps, blocks, rounds=rounds, rng=rng)
    names = [m for m in AUTO_CANDIDATES if m != "als" or blocks.total <= AUTO_LARGEST]
    residual = {m: held_out_residual(m, maps, blocks, rounds=rounds, rng=rng) for m in names}
    best = min(names, key=lambda m: residual[m])
    relaxed, report = relax(best, maps, blocks, rounds=rounds, rng=rng)
    found = ", ".join(f"{m} {100 * residual[m]:.2f} %" for m in names)
    status = f"{report.status}; chosen by held-out residual ({found})"
    return relaxed, CycleReport(report.method, report.converged, report.change, status)
