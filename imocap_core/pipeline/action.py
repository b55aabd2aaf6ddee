"""An action: the folder with the videos to capture, and its action.yaml."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.identifiers import NAME, Id
from imocap_core.io.pose2sim_files import FILES, has_pose2sim_truth
from imocap_core.limits import LAST_FRAME, MAX_DISTORTION, MAX_FPS, MAX_SIDE_PX, MIN_FPS
from imocap_core.pipeline.format_names import DetectionFormat, InitialFormat, Layout
from imocap_core.pipeline.hints import AnchorEntry, ForbiddenEntry, hint_faults
from imocap_core.pipeline.person import Person
from imocap_core.pipeline.yaml_file import load_yaml

FILE_NAME = "action.yaml"
DETECT = "detect"

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Fps = Annotated[float, Field(ge=MIN_FPS, le=MAX_FPS, allow_inf_nan=False)]
Side = Annotated[int, Field(gt=0, le=MAX_SIDE_PX)]
Frame = Annotated[int, Field(ge=0, le=LAST_FRAME)]
Coefficient = Annotated[float, Field(ge=-MAX_DISTORTION, le=MAX_DISTORTION, allow_inf_nan=False)]
Distortion = Annotated[tuple[Coefficient, ...], Field(min_length=1, max_length=5)]
Model = TypeVar("Model", bound=BaseModel)


class Declaration(BaseModel):
    """One video as action.yaml declares it; paths are relative to the action's folder."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    id: Id
    video: str | None = None
    keypoints: str | None = None
    format: DetectionFormat | None = None
    layout: Layout | None = None
    fps: Fps | None = None
    size: tuple[Side, Side] | None = None
    frames: tuple[Frame, Frame] | None = None
    focal_px: Positive | None = None
    distortion: Distortion | None = None  # OpenCV's k1, k2, p1, p2, k3; of a known focal_px
    initial: str | None = None
    initial_format: InitialFormat | None = None
    mirrored: bool | None = None  # None: sync decides
    person: Person | None = None  # the performer; None: the program chooses
    performer: Id | None = None  # who it is; videos of one performer share a body
    repetitions: bool | None = None  # True: a long clip, cut into its repetitions

    @property
    def detected(self) -> bool:
        """Whether the program runs a detector for the keypoints."""
        return self.keypoints == DETECT

    @model_validator(mode="after")
    def _complete(self) -> Declaration:
        faults = []
        if self.frames is not None and self.frames[1] <= self.frames[0]:
            faults.append(f"frames: expected [first, one past last], got {list(self.frames)}")
        if self.video is None and (self.keypoints is None or self.keypoints == DETECT):
            faults.append("expected a video, or keypoints with fps and size")
        if self.video is None and (self.fps is None or self.size is None):
            faults.append("fps and size: expected where there is no video")
        if self.distortion is not None and self.focal_px is None:
            faults.append("distortion: expected focal_px beside it, which its numbers belong to")
        if self.distortion is not None and len(self.distortion) == 3:
            faults.append("distortion: expected k1; k1, k2; k1, k2, p1, p2; or k1, k2, p1, p2, k3")
        if self.initial == DETECT and not self.detected:
            faults.append("initial: detect requires keypoints: detect")
        if self.initial not in (None, DETECT) and self.initial_format is None:
            faults.append("initial_format: expected where initial is given")
        if faults:
            raise ValueError("; ".join(faults))
        return self


class _ActionFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Id
    videos: list[Declaration] = Field(min_length=1)
    truth: str | None = None
    params: dict[str, Any] = Field(default_factory=dict)
    anchors: list[AnchorEntry] = Field(default_factory=list)
    forbidden: list[ForbiddenEntry] = Field(default_factory=list)
    event: bool = False

    @model_validator(mode="after")
    def _belongs_together(self) -> _ActionFile:
        ids = [v.id for v in self.videos]
        repeated = sorted({i for i in ids if ids.count(i) > 1})
        if repeated:
            raise ValueError(f"videos: expected unique ids, got {', '.join(repeated)} twice")
        without = [v.id for v in self.videos if v.performer is None]
        if without and len(without) < len(self.videos):
            raise ValueError(
                f"performer: expected of every video or of none, got none of {', '.join(without)}"
            )
        faults = hint_faults(self.anchors, self.forbidden, ids)
        if faults:
            raise ValueError("; ".join(faults))
        return self


@dataclass(frozen=True)
class Action:
    """A validated action.yaml and the folder that its paths are relative to."""

    folder: Path
    name: str
    videos: tuple[Declaration, ...]
    truth: str | None = None
    params: dict[str, Any] = field(default_factory=dict)
    anchors: tuple[AnchorEntry, ...] = ()
    forbidden: tuple[ForbiddenEntry, ...] = ()
    event: bool = False  # all videos film one and the same performance
    detected: Mapping[str, Path] = field(default_factory=dict)  # video id -> file of detections

    @property
    def file(self) -> Path:
        """Path of its action.yaml."""
        return self.folder / FILE_NAME

    @property
    def truth_files(self) -> tuple[str, ...]:
        """Files that scoring reads: the `truth` of action.yaml, or those of a calibrated rig."""
        if self.truth is not None:
            return (self.truth,)
        return FILES if has_pose2sim_truth(self.folder) else ()


def check_name(name: str) -> None:
    """WrongUse when an action cannot have this name."""
    if not re.fullmatch(NAME, name):
        raise WrongUse(f"invalid action name {name!r}: letters from A to Z, digits, _ . - only")


def find_action(name_or_path: str, root: Path) -> Path:
    """The folder of an action, by name below root/actions or by path.

    WrongUse when there is none; the message lists all actions.
    """
    named = root / "actions" / name_or_path
    for folder in (named, Path(name_or_path)):
        if folder.name == FILE_NAME:
            folder = folder.parent
        if (folder / FILE_NAME).is_file():
            return folder
    names = sorted(p.parent.name for p in (root / "actions").glob(f"*/{FILE_NAME}"))
    existing = f"Existing actions: {', '.join(names)}." if names else "No action exists yet."
    raise WrongUse(
        f"no action {name_or_path!r}: neither {named / FILE_NAME} nor "
        f"{Path(name_or_path) / FILE_NAME} exists. {existing} "
        f"Make one with: imocap init NAME VIDEO..."
    )


def read_action(folder: Path) -> Action:
    """Read and check folder/action.yaml. WorkFailed names every fault in it at once."""
    return action_of(load_yaml(folder / FILE_NAME), folder)


def action_of(data: Any, folder: Path) -> Action:
    """The action that the content of folder/action.yaml declares. WorkFailed names every fault."""
    parsed = parse(_ActionFile, data, str(folder / FILE_NAME))
    return Action(
        folder=folder.resolve(),
        name=parsed.name,
        videos=tuple(parsed.videos),
        truth=parsed.truth,
        params=parsed.params,
        anchors=tuple(parsed.anchors),
        forbidden=tuple(parsed.forbidden),
        event=parsed.event,
    )


def parse(model: type[Model], data: Any, file: str) -> Model:
    """`data` as `model`; WorkFailed with one line a fault: file, field, expected, got."""
    if not isinstance(data, dict):
        raise WorkFailed(f"{file}: expected fields like 'name: value', got {_short(data)}")
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise WorkFailed(explain_faults(error, file)) from None


def explain_faults(error: ValidationError, file: str) -> str:
    """Every fault of a validation in one line each: file, field, expected, got."""
    lines = []
    for fault in error.errors(include_url=False):
        where = ".".join(map(str, fault["loc"])) or "(whole file)"
        message = fault["msg"].removeprefix("Value error, ")
        if fault["type"] == "missing":
            lines.append(f"{file}: {where}: is missing")
        elif fault["type"] == "extra_forbidden":
            lines.append(f"{file}: {where}: unknown field")
        elif fault["type"] == "value_error":
            lines.append(f"{file}: {where}: {message}")
        else:
            lines.append(f"{file}: {where}: {message}, got {_short(fault['input'])}")
    return "\n".join(lines)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
