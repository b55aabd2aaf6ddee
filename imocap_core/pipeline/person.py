"""`person` in action.yaml: who performs in a video, where the program would choose another."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator


class Person(BaseModel):
    """A track's number, or a point or box (x0, y0, x1, y1) in pixels and the source frame."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    track: Annotated[int, Field(ge=1)] | None = None
    frame: Annotated[int, Field(ge=0)] | None = None
    at: tuple[float, float] | None = None
    box: tuple[float, float, float, float] | None = None

    @model_validator(mode="after")
    def _one_way(self) -> Person:
        ways = [name for name in ("track", "at", "box") if getattr(self, name) is not None]
        if len(ways) != 1:
            got = " and ".join(ways) or "nothing"
            raise ValueError(f"expected one of track, at, box, got {got}")
        if (self.track is None) != (self.frame is not None):
            raise ValueError(
                "at and box need the frame in which they are, and track takes none; got "
                f"{'no frame' if self.frame is None else 'a frame beside track'}"
            )
        if self.box is not None and not (self.box[0] < self.box[2] and self.box[1] < self.box[3]):
            raise ValueError(f"box: expected x0 < x1 and y0 < y1, got {list(self.box)}")
        return self
