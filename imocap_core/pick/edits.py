"""The edits of an action.yaml that the page can ask for."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from imocap_core.identifiers import Id
from imocap_core.limits import LAST_FRAME
from imocap_core.pipeline.person import Person

FrameNumber = Annotated[int, Field(ge=0, le=LAST_FRAME, strict=True)]


class _Edit(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class PersonEdit(_Edit):
    """Who performs in a video; None: the program decides."""

    kind: Literal["person"]
    video: Id
    person: Person | None


class FramesEdit(_Edit):
    """The used frames, first and one past the last; None: all."""

    kind: Literal["frames"]
    video: Id
    frames: tuple[FrameNumber, FrameNumber] | None


class MirroredEdit(_Edit):
    """Whether a video is a mirror image; None: the program decides."""

    kind: Literal["mirrored"]
    video: Id
    mirrored: bool | None


class DetectEdit(_Edit):
    """People are to be detected in a video that has no keypoints."""

    kind: Literal["detect"]
    video: Id


class DropEdit(_Edit):
    """A video leaves the action, with its anchors and forbidden spans."""

    kind: Literal["drop"]
    video: Id


class SplitEdit(_Edit):
    """A video becomes several of one file; `starts`: the frames with which new ones begin."""

    kind: Literal["split"]
    video: Id
    starts: Annotated[list[FrameNumber], Field(min_length=1, max_length=500)]


class AddAnchorEdit(_Edit):
    """Frames of at least two videos that show the same moment."""

    kind: Literal["add_anchor"]
    frames: Annotated[dict[Id, FrameNumber], Field(min_length=2)]
    hard: bool = False


class AnchorEdit(_Edit):
    """Anchor `number`, from 0, becomes hard or not; None: it is removed."""

    kind: Literal["anchor"]
    number: Annotated[int, Field(ge=0)]
    hard: bool | None


class PerformersEdit(_Edit):
    """Who performs in every video, by name; None: one person in all of them."""

    kind: Literal["performers"]
    performers: Annotated[dict[Id, Id], Field(min_length=1)] | None


class EventEdit(_Edit):
    """Whether all videos film one and the same performance."""

    kind: Literal["event"]
    event: bool


class AddForbiddenEdit(_Edit):
    """Frames of a video, first and one past the last, that match nothing."""

    kind: Literal["add_forbidden"]
    video: Id
    frames: tuple[FrameNumber, FrameNumber]


class ForbiddenEdit(_Edit):
    """Forbidden span `number`, from 0, is removed."""

    kind: Literal["forbidden"]
    number: Annotated[int, Field(ge=0)]


Edit = Annotated[
    PersonEdit
    | FramesEdit
    | MirroredEdit
    | DetectEdit
    | DropEdit
    | SplitEdit
    | AddAnchorEdit
    | AnchorEdit
    | PerformersEdit
    | EventEdit
    | AddForbiddenEdit
    | ForbiddenEdit,
    Field(discriminator="kind"),
]
