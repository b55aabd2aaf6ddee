"""Detection errors particular to a kind of keypoint: its noise, outliers and systematic offset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.conventions import point_towards, sideless


@dataclass(frozen=True)
class KeypointErrors:
    """Errors of a kind of keypoint ("wrist" of both sides), relative to the detector's.

    noise, outliers: factors of the detector's noise and outlier_rate. towards, share: systematic
    offset by this share of the way to that point (`conventions.point_towards`; "" for none).
    """

    noise: float = 1.0
    outliers: float = 1.0
    towards: str = ""
    share: float = 0.0


def offset_target(name: str, by_kind: Mapping[str, KeypointErrors]) -> tuple[str, float]:
    """The point towards which a keypoint is offset, and the share of the way; ("", 0) for none."""
    errors = by_kind.get(sideless(name), KeypointErrors())
    return (point_towards(name, errors.towards), errors.share) if errors.towards else ("", 0.0)


def error_factors(
    names: Sequence[str], by_kind: Mapping[str, KeypointErrors]
) -> tuple[Float[np.ndarray, " K"], Float[np.ndarray, " K"]]:
    """Factors of the noise and of the outlier rate of each keypoint."""
    errors = [by_kind.get(sideless(name), KeypointErrors()) for name in names]
    return np.array([e.noise for e in errors]), np.array([e.outliers for e in errors])


def with_offsets(
    xy: Float[np.ndarray, "T K D"], names: Sequence[str], by_kind: Mapping[str, KeypointErrors]
) -> Float[np.ndarray, "T K D"]:
    """Keypoints with their systematic offsets; those whose target is not among the names stay."""
    offset = xy.copy()
    for k, name in enumerate(names):
        target, share = offset_target(name, by_kind)
        if target in names:
            offset[:, k] += share * (xy[:, names.index(target)] - xy[:, k])
    return offset
