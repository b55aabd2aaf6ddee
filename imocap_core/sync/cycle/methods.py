"""Cycle-consistency methods by name, and the choice among them by held-out residual."""

from __future__ import annotations

import numpy as np

from imocap_core.sync.block_maps import BlockMaps
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
    method: str, maps: BlockMaps, *, rounds: int, rng: np.random.Generator
) -> tuple[BlockMaps, CycleReport]:
    """Denoise soft maps or affinities by one of METHODS or by `auto` (`relax_auto`); with fewer
    than three videos there is no cycle and they are returned as they are.

    `rounds` compositions of `softmap`; `rng` draws the starting factor of `als`.
    """
    if method == "auto":
        return relax_auto(maps, rounds=rounds, rng=rng)
    if method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, auto; got {method!r}")
    if method == "none" or len(maps.blocks.lengths) < 3:
        why = (
            "none: switched off" if method == "none" else "none: fewer than three videos, no cycle"
        )
        return maps, CycleReport("none", True, (), why)
    if method == "softmap":
        return softmap(maps, rounds=rounds)
    affinity = symmetric_affinity(maps.dense(), maps.blocks)
    if method == "als":
        relaxed, report = als(affinity, maps.blocks, rng=rng)
    else:
        relaxed, report = svt(affinity, maps.blocks)
    return BlockMaps.of(relaxed, maps.blocks), report


def held_out_residual(
    method: str, maps: BlockMaps, *, rounds: int, rng: np.random.Generator
) -> float:
    """Error of direct maps predicted through the other videos; mean, as a share of the clip.

    Videos are paired off (0-1, 2-3, ...), those direct maps are left out, and the maps that the
    method reconstructs through the other videos are compared, position by position, with the
    ones left out.
    """
    M = len(maps.blocks.lengths)
    pairs = [(v, v + 1) for v in range(0, M - 1, 2)]
    hidden = {pair for i, j in pairs for pair in ((i, j), (j, i))}
    shown = {pair: soft_map for pair, soft_map in maps.pairs.items() if pair not in hidden}
    filled, _ = relax(method, BlockMaps(maps.blocks, shown), rounds=rounds, rng=rng)
    errors = []
    for i, j in pairs:
        direct, indirect = (median_positions(m.pair(i, j)) for m in (maps, filled))
        errors.append(float(np.mean(np.abs(direct - indirect))) / maps.blocks.lengths[j])
    return float(np.mean(errors))


def relax_auto(
    maps: BlockMaps, *, rounds: int, rng: np.random.Generator
) -> tuple[BlockMaps, CycleReport]:
    """The method with the smallest held-out residual; the factorisation only where it is
    affordable."""
    if len(maps.blocks.lengths) < 3:
        return relax("none", maps, rounds=rounds, rng=rng)
    names = [m for m in AUTO_CANDIDATES if m != "als" or maps.blocks.total <= AUTO_LARGEST]
    residual = {m: held_out_residual(m, maps, rounds=rounds, rng=rng) for m in names}
    best = min(names, key=lambda m: residual[m])
    relaxed, report = relax(best, maps, rounds=rounds, rng=rng)
    residuals = ", ".join(f"{m} {100 * residual[m]:.2f} %" for m in names)
    status = f"{report.status}; chosen by held-out residual ({residuals})"
    return relaxed, CycleReport(report.method, report.converged, report.change, status)
