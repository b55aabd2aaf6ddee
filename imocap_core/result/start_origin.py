"""A levelled world whose origin is where the motion begins."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from imocap_core.camera.world import GroundAlignment, heading, on_floor, y_up_axes
from imocap_core.result.ground import moved
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult

Kind = TypeVar("Kind", bound=ActionResult)


def from_start(result: Kind, video: VideoResult) -> Kind:
    """The same in a world with the origin on the floor under the first pose of one of its videos
    (or of their mean), which faces forward (+z with y up, -y with z up).

    ValueError unless the result is levelled.
    """
    up = result.up_axis
    if up not in ("y", "z"):
        raise ValueError(f"up: expected a levelled world, got {up} up")
    t = int(np.argmax(video.inside))
    to_y = y_up_axes(up)
    turn = to_y.T @ heading(to_y @ video.rotations[t : t + 1, 0])[0].T @ to_y
    place = GroundAlignment(turn, -turn @ on_floor(video.body_joints[t, 0], up))
    return replace(
        result,
        videos=tuple(moved(v, place) for v in result.videos),
        ground=result.ground.moved(turn, place.t),
    )
