"""Cycle-consistency methods by name, and the choice among them by held-out residual."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.sync.blocks import Blocks
from imocap_core.sync.cycle.als import als
from imocap_core.sync.cycle.report import CycleReport
from imocap_core.sync.cycle.row_contrast import symmetric_affinity
from imocap_core.sync.cycle.softmap import softmap
from imocap_core.sync.cycle.svt import svt
from imocap_core.sync.warp.positions import median_positions

METHODS = ("softmap", "als", "svt", "none")
AUTO_CANDIDATES = ("softmap", "als")
AUTO_LARGEST = 1600  # frames of all videos up to which `auto` also tries the factorisation


def relax(
    method: str,
    maps: Float[np.ndarray, "N_a N_a"],
    blocks: Blocks,
    *,
    rounds: int,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "N_a N_a"], CycleReport]:
    """Denoise soft maps or affinities by one of METHODS or by `auto` (`relax_auto`); with fewer
    than three videos there is no cycle and they are returned as they are.

    `rounds` compositions of `softmap`; `rng` draws the starting factor of `als`.
    """
    if method == "auto":
        return relax_auto(maps, blocks, rounds=rounds, rng=rng)
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
    method: str,
    maps: Float[np.ndarray, "N_a N_a"],
    blocks: Blocks,
    *,
    rounds: int,
    rng: np.random.Generator,
) -> float:
    """Error of direct maps predicted through the other videos; mean, as a share of the clip.

    Videos are paired off (0-1, 2-3, ...), those direct blocks are emptied, and the blocks that the
    method reconstructs through the other videos are compared, position by position, with the
    emptied ones.
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
        indirect = median_positions(np.asarray(blocks.block(filled, i, j), dtype=float))
        errors.append(float(np.mean(np.abs(direct - indirect))) / blocks.lengths[j])
    return float(np.mean(errors))


def relax_auto(
    maps: Float[np.ndarray, "N_a N_a"],
    blocks: Blocks,
    *,
    rounds: int,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "N_a N_a"], CycleReport]:
    """The method with the smallest held-out residual; the factorisation only where it is
    affordable."""
    if len(blocks.lengths) < 3:
        return relax("none", maps, blocks, rounds=rounds, rng=rng)
    names = [m for m in AUTO_CANDIDATES if m != "als" or blocks.total <= AUTO_LARGEST]
    residual = {m: held_out_residual(m, maps, blocks, rounds=rounds, rng=rng) for m in names}
    best = min(names, key=lambda m: residual[m])
    relaxed, report = relax(best, maps, blocks, rounds=rounds, rng=rng)
    residuals = ", ".join(f"{m} {100 * residual[m]:.2f} %" for m in names)
    status = f"{report.status}; chosen by held-out residual ({residuals})"
    return relaxed, CycleReport(report.method, report.converged, report.change, status)
