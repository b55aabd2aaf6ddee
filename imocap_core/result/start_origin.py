"""A levelled world whose origin is where the motion begins."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from imocap_core.camera.world import GroundAlignment, heading, on_floor, y_up_axes
from imocap_core.result.ground import moved
from imocap_core.result.result import ActionResult

Kind = TypeVar("Kind", bound=ActionResult)


def from_start(result: Kind) -> Kind:
    """The same in a world with the origin on the floor under the first video's first pose, which
    faces forward (+z with y up, -y with z up).

    ValueError unless the result is levelled.
    """
    if result.up_axis not in ("y", "z"):
        raise ValueError(f"up: expected a levelled world, got {result.up_axis} up")
    first = result.videos[0]
    t = int(np.argmax(first.inside))
    to_y = y_up_axes(result.up_axis)
    turn = to_y.T @ heading(to_y @ first.rotations[t : t + 1, 0])[0].T @ to_y
    place = GroundAlignment(turn, -turn @ on_floor(first.body_joints[t, 0], result.up_axis))
    return replace(
        result,
        videos=tuple(moved(video, place) for video in result.videos),
        ground=result.ground.moved(turn, place.t),
    )
