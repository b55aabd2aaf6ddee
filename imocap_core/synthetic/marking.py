"""What is particular to a kind of point: how hard it is to find, and where it is marked instead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from imocap_core.conventions import point_towards, sideless
from imocap_core.render.arrays import Floats


@dataclass(frozen=True)
class Marking:
    """A kind of point ("wrist" of both sides), beside the detector's own numbers.

    noise, outliers: factors of the detector's noise and outlier_rate; towards, share: it is marked
    this share of the way to that point (`conventions.point_towards`; "" for nowhere).
    """

    noise: float = 1.0
    outliers: float = 1.0
    towards: str = ""
    share: float = 0.0


def target_of(name: str, marking: Mapping[str, Marking]) -> tuple[str, float]:
    """The point towards which a point is marked, and the share of the way; ("", 0) for none."""
    own = marking.get(sideless(name), Marking())
    return (point_towards(name, own.towards), own.share) if own.towards else ("", 0.0)


def factors(names: Sequence[str], marking: Mapping[str, Marking]) -> tuple[Floats, Floats]:
    """Factors (K,) of the noise and of the outlier rate."""
    own = [marking.get(sideless(name), Marking()) for name in names]
    return np.array([m.noise for m in own]), np.array([m.outliers for m in own])


def marked(xy: Floats, names: Sequence[str], marking: Mapping[str, Marking]) -> Floats:
    """Where points (T, K, D) are marked; those whose target is not among the names stay."""
    found = xy.copy()
    for k, name in enumerate(names):
        target, share = target_of(name, marking)
        if target in names:
            found[:, k] += share * (xy[:, names.index(target)] - xy[:, k])
    return found
