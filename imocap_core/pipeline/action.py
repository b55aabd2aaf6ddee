"""An action: the folder with the videos to capture, its action.yaml, and where its files lie.

Where the files of videos lie when an action is taken along: inside its folder. Results say where
files lie in these terms, so that an action with videos anywhere and the same one with them inside
have results of the same digests.
"""

from __future__ import annotations

import os
import posixpath
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path, PureWindowsPath
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from imocap_core.errors import WorkFailed, WrongUse, did_you_mean
from imocap_core.files import RIG_FILES, has_pose2sim_truth
from imocap_core.identifiers import NAME, Id
from imocap_core.limits import LAST_FRAME, MAX_DISTORTION, MAX_FPS, MAX_SIDE_PX, MIN_FPS
from imocap_core.pipeline.format_names import DetectionFormat, InitialFormat, Layout
from imocap_core.pipeline.source import content_digest
from imocap_core.pipeline.yaml_file import load_yaml


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


HintFrame = Annotated[int, Field(ge=0, strict=True)]


class AnchorEntry(BaseModel):
    """`{v1: 120, v2: 88, hard: true}`: these source frames show the same moment."""

    model_config = ConfigDict(frozen=True, extra="allow")
    __pydantic_extra__: dict[str, HintFrame] = Field(init=False)

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
    frames: tuple[HintFrame, HintFrame]

    @model_validator(mode="after")
    def _not_empty(self) -> ForbiddenEntry:
        if self.frames[1] <= self.frames[0]:
            raise ValueError(f"frames: expected [first, one past last], got {list(self.frames)}")
        return self


def _hint_faults(
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

    model_config = ConfigDict(frozen=True, extra="forbid", coerce_numbers_to_str=True)

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
    event: bool | None = None

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
        faults = _hint_faults(self.anchors, self.forbidden, ids)
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
    event: bool | None = None  # all videos film one and the same performance; None: not declared
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
        return RIG_FILES if has_pose2sim_truth(self.folder) else ()


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
        f"Make one with: imocap init NAME VIDEO...{did_you_mean(name_or_path, names)}"
    )


def read_action(folder: Path) -> Action:
    """Read and check folder/action.yaml. WorkFailed names every fault in it at once."""
    return action_of(load_yaml(folder / FILE_NAME), folder)


def action_of(data: Any, folder: Path) -> Action:
    """The action that the content of folder/action.yaml declares. WorkFailed names every fault."""
    parsed = parse(_ActionFile, data, str(folder / FILE_NAME))
    given: dict[str, Any] = {name: tuple(v) if isinstance(v, list) else v for name, v in parsed}
    return Action(folder=folder.resolve(), **given)


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
            given = str(fault["loc"][-1])
            near = did_you_mean(given, (*_ActionFile.model_fields, *Declaration.model_fields))
            lines.append(f"{file}: {where}: unknown field{'.' * bool(near)}{near}")
        elif fault["type"] == "value_error":
            lines.append(f"{file}: {where}: {message}")
        else:
            message = message.replace("Input should be", "expected").replace("valid tuple", "list")
            lines.append(f"{file}: {where}: {message}, got {_short(fault['input'])}")
    return "\n".join(lines)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def declared_path(file: Path, folder: Path) -> str:
    """The path of a file from an action's folder; the whole path where they share no drive."""
    try:
        return Path(os.path.relpath(file.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return file.resolve().as_posix()


def path_of(folder: Path, declared: str) -> Path:
    """The inverse of `declared_path`, without `..`, for messages too."""
    path = folder / declared
    return path.resolve() if ".." in path.parts else path


_FOLDERS = {"video": "videos", "keypoints": "keypoints", "initial": "initial"}  # by key


def leads_outside(given: str) -> bool:
    """Whether a path, as action.yaml has it, leads out of the action's folder."""
    path = PureWindowsPath(given)
    absolute = bool(path.drive) or path.as_posix().startswith("/")
    return absolute or posixpath.normpath(path.as_posix()).split("/")[0] == ".."


def placed(videos: Sequence[Declaration]) -> tuple[Declaration, ...]:
    """The declarations with all their files inside the action's folder; the rest as it is.

    A file from outside goes to the folder of its kind, under its name; where that place is taken by
    another one, the video's id comes before it.
    """
    given = [
        (v, key, path)
        for v in videos
        for key in _FOLDERS
        if (path := getattr(v, key)) not in (None, DETECT)
    ]
    taken = {_same(path): path for _, _, path in given if not leads_outside(path)}
    moved: dict[str, dict[str, str]] = {}
    for video, key, path in given:
        if leads_outside(path):
            name = PureWindowsPath(path).name
            place = f"{_FOLDERS[key]}/{name}"
            while taken.setdefault(_same(place), path) != path:
                name = f"{video.id}_{name}"
                place = f"{_FOLDERS[key]}/{name}"
            moved.setdefault(video.id, {})[key] = place
    return tuple(video.model_copy(update=moved.get(video.id, {})) for video in videos)


def _same(path: str) -> str:
    """What two paths to one place have in common, on systems that do not tell a from A too."""
    return posixpath.normpath(PureWindowsPath(path).as_posix()).casefold()


def repeated_files(action: Action) -> list[str]:
    """A sentence on every two videos that use the same frames of one file's content."""
    groups: dict[str, list[Declaration]] = defaultdict(list)
    for video in action.videos:
        if video.video is not None and (action.folder / video.video).is_file():
            groups[content_digest(action.folder / video.video)].append(video)
    return [
        f"{b.id} is the same file as {a.id}: it adds no view; remove one of them from {action.file}"
        for group in groups.values()
        for a, b in combinations(group, 2)
        if _overlap(a.frames, b.frames)
    ]


def repeated_paths(files: Sequence[Path]) -> list[str]:
    """A sentence on every two files of the same content."""
    digests = [content_digest(file) for file in files]
    return [
        f"{b} is the same file as {a}: it adds no view"
        for (a, first), (b, second) in combinations(zip(files, digests, strict=True), 2)
        if first == second
    ]


def _overlap(a: tuple[int, int] | None, b: tuple[int, int] | None) -> bool:
    """Whether two spans [first, one past last] of frames, None for all, have a frame in common."""
    return a is None or b is None or (a[0] < b[1] and b[0] < a[1])
