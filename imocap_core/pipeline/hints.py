"""What action.yaml says of the time in its videos: anchors and forbidden spans."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

Frame = Annotated[int, Field(ge=0, strict=True)]


class AnchorEntry(BaseModel):
    """`{v1: 120, v2: 88, hard: true}`: these source frames show the same moment."""

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, Frame] = Field(init=False)

    hard: bool = False

    @property
    def frames(self) -> dict[str, int]:
        """Video id -> source frame."""
        return dict(self.__pydantic_extra__)

    @model_validator(mode="after")
    def _ties_two(self) -> AnchorEntry:
        if len(self.frames) < 2:
            raise ValueError(
                "an anchor ties frames of two videos or more, as {v1: 120, v2: 88}; got "
                f"{self.frames or 'none'}"
            )
        return self


class ForbiddenEntry(BaseModel):
    """`{video: v1, frames: [0, 40]}`: the first and one past the last frame that match nothing."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    video: str
    frames: tuple[Frame, Frame]

    @model_validator(mode="after")
    def _not_empty(self) -> ForbiddenEntry:
        if self.frames[1] <= self.frames[0]:
            raise ValueError(
                f"frames {list(self.frames)} are empty: expected [first, one past last]"
            )
        return self


def hint_faults(
    anchors: Sequence[AnchorEntry], forbidden: Sequence[ForbiddenEntry], ids: Sequence[str]
) -> list[str]:
    """Every video that is not there, every two anchors that cross in time, every anchor on a frame
    that is forbidden."""
    known = f"there are: {', '.join(ids)}"
    faults = [
        f"anchors.{n}: no video {video!r}; {known}"
        for n, anchor in enumerate(anchors)
        for video in anchor.frames
        if video not in ids
    ]
    faults += [
        f"forbidden.{n}: no video {span.video!r}; {known}"
        for n, span in enumerate(forbidden)
        if span.video not in ids
    ]
    for (m, x), (n, y) in combinations(enumerate(anchors), 2):
        for a, b in combinations([v for v in x.frames if v in y.frames], 2):
            if (x.frames[a] - y.frames[a]) * (x.frames[b] - y.frames[b]) <= 0 and (
                x.frames[a],
                x.frames[b],
            ) != (y.frames[a], y.frames[b]):
                faults.append(
                    f"anchors.{m} and anchors.{n} cross in time: {a} {x.frames[a]} = {b} "
                    f"{x.frames[b]}, but {a} {y.frames[a]} = {b} {y.frames[b]}"
                )
    faults += [
        f"anchors.{n}: frame {frame} of {video} lies in a forbidden span {list(span.frames)}"
        for n, anchor in enumerate(anchors)
        for video, frame in anchor.frames.items()
        for span in forbidden
        if span.video == video and span.frames[0] <= frame < span.frames[1]
    ]
    return faults
