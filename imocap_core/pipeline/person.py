"""`person` in action.yaml: the performer of a video, where the program would choose another."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator


class Person(BaseModel):
    """A track's number, or a point or box (x0, y0, x1, y1) in pixels of one source frame."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    track: Annotated[int, Field(ge=1)] | None = None
    frame: Annotated[int, Field(ge=0)] | None = None
    point_px: Annotated[tuple[float, float] | None, Field(alias="at")] = None
    box: tuple[float, float, float, float] | None = None

    @model_validator(mode="after")
    def _one_choice(self) -> Person:
        choices = {"track": self.track, "at": self.point_px, "box": self.box}
        given = [name for name, value in choices.items() if value is not None]
        if len(given) != 1:
            got = " and ".join(given) or "nothing"
            raise ValueError(f"expected one of track, at, box, got {got}")
        if (self.track is None) != (self.frame is not None):
            raise ValueError(
                "frame: expected with at and box, and not with track; got "
                f"{'none' if self.frame is None else 'frame and track'}"
            )
        if self.box is not None and not (self.box[0] < self.box[2] and self.box[1] < self.box[3]):
            raise ValueError(f"box: expected x0 < x1 and y0 < y1, got {list(self.box)}")
        return self
