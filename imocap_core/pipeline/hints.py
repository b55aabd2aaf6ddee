"""The user's hints for the synchronisation in action.yaml: anchors and forbidden spans."""

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
    def _has_two_videos(self) -> AnchorEntry:
        if len(self.frames) < 2:
            raise ValueError(
                "expected frames of at least two videos, as in {v1: 120, v2: 88}; got "
                f"{self.frames or 'none'}"
            )
        return self


class ForbiddenEntry(BaseModel):
    """`{video: v1, frames: [0, 40]}`: frames [first, one past last] that match no other video."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    video: str
    frames: tuple[Frame, Frame]

    @model_validator(mode="after")
    def _not_empty(self) -> ForbiddenEntry:
        if self.frames[1] <= self.frames[0]:
            raise ValueError(f"frames: expected [first, one past last], got {list(self.frames)}")
        return self


def hint_faults(
    anchors: Sequence[AnchorEntry], forbidden: Sequence[ForbiddenEntry], ids: Sequence[str]
) -> list[str]:
    """One sentence for every unknown video, every two anchors that contradict the order of time,
    and every anchor on a forbidden frame."""
    expected = f"expected one of {', '.join(ids)}"
    faults = [
        f"anchors.{n}: unknown video {video!r}; {expected}"
        for n, anchor in enumerate(anchors)
        for video in anchor.frames
        if video not in ids
    ]
    faults += [
        f"forbidden.{n}: unknown video {span.video!r}; {expected}"
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
                    f"anchors.{m} and anchors.{n} contradict the order of time: "
                    f"{a} {x.frames[a]} = {b} {x.frames[b]}, "
                    f"but {a} {y.frames[a]} = {b} {y.frames[b]}"
                )
    faults += [
        f"anchors.{n}: frame {frame} of {video} is in the forbidden span {list(span.frames)}"
        for n, anchor in enumerate(anchors)
        for video, frame in anchor.frames.items()
        for span in forbidden
        if span.video == video and span.frames[0] <= frame < span.frames[1]
    ]
    return faults
