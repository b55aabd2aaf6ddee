"""The mean of all performances of an action, as one clean clip."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float

from imocap_core.result.body import body_model, local_rotations, posed_joints
from imocap_core.result.result import ActionResult
from imocap_core.rotations import log, mean

Kind = TypeVar("Kind", bound=ActionResult)
NAME = "mean"
FADE_S = 0.25  # in which a performance that begins or ends gains or loses its weight


def mean_performance(result: Kind) -> Kind:
    """A result of one video, `mean`: the mean of the videos' poses and root paths.

    The result is on the common time axis. Rotations are averaged on the manifold (chordal mean),
    the bodies' shapes too. A moment that no video shows is that of the nearest poses. The camera
    and everything else are the reference's.
    """
    videos = result.videos
    weights = np.stack([fade(video.inside, video.fps) for video in videos])
    nobody = weights.sum(axis=0) == 0
    weights[:, nobody] = 1.0
    R = torch.as_tensor(np.stack([local_rotations(video.theta) for video in videos]))
    turned = mean(R, torch.as_tensor(weights)[..., None])
    theta = log(turned).numpy().reshape(len(videos[0]), -1)
    share = weights / weights.sum(axis=0)
    trans = np.einsum("mt,mti->ti", share, np.stack([video.trans for video in videos]))
    betas = np.mean([video.betas for video in videos], axis=0)
    first = result[result.reference] if result.reference in result else videos[0]
    model = body_model(first.model, result.action, hands=False)
    clip = replace(
        first,
        id=NAME,
        theta=theta,
        betas=betas,
        trans=trans,
        body_joints=posed_joints(model, betas, theta, trans),
        hands=None,
        inside=~nobody,
        joint_uncertainty=None,
    )
    return replace(result, videos=(clip,), reference=NAME)


def fade(inside: Bool[np.ndarray, " T"], fps: float) -> Float[np.ndarray, " T"]:
    """Weights that rise from 0 outside to 1 within `FADE_S` of the first and last moment shown."""
    shown = np.flatnonzero(inside)
    if len(shown) == 0:
        return np.zeros(len(inside))
    t = np.arange(len(inside))
    depth = np.minimum(t - shown[0], shown[-1] - t) + 1.0
    return np.where(inside, np.clip(depth / (FADE_S * fps + 1), 0.0, 1.0), 0.0)
