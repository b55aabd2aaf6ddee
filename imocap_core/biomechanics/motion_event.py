"""An event of a motion, and how well its moment is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

Kind = Literal["contact_begin", "contact_end", "fastest", "largest", "smallest"]
Unit = Literal["", "m/s", "deg"]


@dataclass(frozen=True)
class MotionEvent:
    """Something that happens at one moment of a video.

    Attributes:
        kind: contact_begin and contact_end of a foot; fastest: a joint's speed has a peak; largest
            and smallest: an angle turns.
        name: of the foot's side, the joint, or the angle.
        index: the moment, a fractional position among the frames.
        earliest, latest: bounds of the moment. Of a contact: between them the foot changes from
            certainly moving to certainly resting, or back. Of a speed or an angle: it is within one
            standard deviation of its extreme there. NaN where nothing tells.
        value: the joint's speed (m/s) or the angle (deg); NaN of contacts. unit: of value.
        sd: standard deviation of value; NaN where unknown.
    """

    kind: Kind
    name: str
    index: float
    earliest: float
    latest: float
    value: float
    sd: float
    unit: Unit

    def later(self, frames: int) -> MotionEvent:
        """The same event, counted from an earlier first frame."""
        return replace(
            self,
            index=self.index + frames,
            earliest=self.earliest + frames,
            latest=self.latest + frames,
        )
