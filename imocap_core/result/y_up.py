"""A levelled world with z up, turned so that y points up."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from imocap_core.camera.world import GroundAlignment, y_up_axes
from imocap_core.result.ground import moved
from imocap_core.result.result import ActionResult

Kind = TypeVar("Kind", bound=ActionResult)


def turned_y_up(result: Kind) -> Kind:
    """The same with y up: (x, y, z) becomes (x, z, -y). One that has y up stays as it is.

    ValueError unless the result is levelled.
    """
    if result.up_axis == "y":
        return result
    if result.up_axis != "z":
        raise ValueError(f"up: expected a levelled world, got {result.up_axis} up")
    turn = GroundAlignment(y_up_axes("z"), np.zeros(3))
    return replace(
        result,
        videos=tuple(moved(video, turn) for video in result.videos),
        ground=result.ground.moved(turn.R_upright_from_world, turn.t),
        up_axis="y",
    )
