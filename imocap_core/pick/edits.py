"""The edits of an action.yaml that the page can ask for, applied to its content."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from imocap_core.identifiers import Id
from imocap_core.limits import LAST_FRAME
from imocap_core.pipeline.action import DETECT, Person


def _video_entry(data: Any, video: str) -> Any:
    """The entry of a video. ValueError when there is none."""
    for entry in data["videos"]:
        if entry["id"] == video:
            return entry
    raise ValueError(f"there is no video {video} in action.yaml")


def flow(value: Any) -> Any:
    """Lists and mappings in one line, as people write them."""
    if isinstance(value, dict):
        line: Any = CommentedMap((key, flow(item)) for key, item in value.items())
    elif isinstance(value, (list, tuple)):
        line = CommentedSeq(map(flow, value))
    else:
        return value
    line.fa.set_flow_style()
    return line


def put(entry: Any, field: str, value: Any) -> None:
    """Set a field; without a value it is null where it stands, and else absent.

    A new field comes before the last one, behind which comments on what follows may stand.
    """
    if field in entry:
        entry[field] = flow(value)
    elif value is not None and isinstance(entry, CommentedMap):
        entry.insert(max(len(entry) - 1, 1), field, flow(value))
    elif value is not None:
        entry[field] = value if not isinstance(value, tuple) else list(value)


def _remove_items(data: Any, field: str, unwanted: Callable[[Any], bool]) -> None:
    """Remove items of a list; the field goes with the last one."""
    items = data.get(field) or []
    for n in reversed([n for n, item in enumerate(items) if unwanted(item)]):
        del items[n]
    if field in data and not items:
        del data[field]


def append(data: Any, field: str, item: Any) -> None:
    """Add an item to a list, an item a line; the field may be new."""
    if data.get(field):
        data[field].append(item)
    else:
        data[field] = CommentedSeq([item]) if isinstance(data, CommentedMap) else [item]


def _item_of(data: Any, field: str, number: int, what: str) -> Any:
    """Item `number` of a list, from 0. ValueError when there is none."""
    items = data.get(field) or []
    if number >= len(items):
        raise ValueError(f"there is no {what} {number + 1} in action.yaml")
    return items[number]


Counts = Mapping[str, int]
"""Frames of each video's file, where they are counted."""


def person_fields(person: Person) -> dict[str, Any]:
    """As a person's declaration is written: whole pixels without a decimal point."""
    fields = person.model_dump(mode="json", by_alias=True, exclude_none=True)
    for name in fields.keys() & {"at", "box"}:
        fields[name] = [int(v) if v == int(v) else v for v in fields[name]]
    return fields


def _split_video(data: Any, video: str, starts: Sequence[int], count: int | None) -> None:
    """Split a video where new ones begin; the first part keeps its id.

    ValueError when a place is outside the used frames.
    """
    entry = _video_entry(data, video)
    if entry.get("frames") is None and count is None:
        raise ValueError(f"{video}: its frames are not counted yet; wait until it has been read")
    first, stop = entry.get("frames") or (0, count or 0)
    edges: list[int] = [first, *sorted(set(starts)), stop]
    if any(b <= a for a, b in pairwise(edges)):
        raise ValueError(f"{video}: expected places to split between frames {first} and {stop}")
    names = [video, *_new_names(data, video, len(edges) - 2)]
    parts = dict(zip(names, pairwise(edges), strict=True))
    place = data["videos"].index(entry) + 1
    for name, span in list(parts.items())[1:]:
        part = _plain(entry) | {"id": name, "frames": list(span)}
        person = part.get("person")  # of other frames, or by a number, which a part may not have
        if person is not None and (person.get("track") or not _person_is_in(part, span)):
            del part["person"]
        data["videos"].insert(place, _as_written(entry, part))
        place += 1
    put(entry, "frames", list(parts[video]))
    if not _person_is_in(entry, parts[video]):
        put(entry, "person", None)
    for anchor in data.get("anchors") or []:
        _move_anchor(anchor, video, parts)
    _split_forbidden(data, video, parts)


def _new_names(data: Any, video: str, number: int) -> list[str]:
    taken = {entry["id"] for entry in data["videos"]}
    names: list[str] = []
    n = 2
    while len(names) < number:
        if f"{video}_{n}" not in taken:
            names.append(f"{video}_{n}")
        n += 1
    return names


def _plain(value: Any) -> Any:
    """Without comments, which belong to the original."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list) else value


def _as_written(entry: Any, part: dict[str, Any]) -> Any:
    """In one line where the original is, else a line a field."""
    if not isinstance(entry, CommentedMap):
        return part
    if entry.fa.flow_style():
        return flow(part)
    return CommentedMap((field, flow(value)) for field, value in part.items())


def _person_is_in(entry: Any, span: tuple[int, int]) -> bool:
    person = entry.get("person")
    return person is None or person.get("frame") is None or span[0] <= person["frame"] < span[1]


def _move_anchor(anchor: Any, video: str, parts: Mapping[str, tuple[int, int]]) -> None:
    """To the part of a video that its frame is in."""
    frame = anchor.get(video)
    for name, (first, stop) in parts.items():
        if frame is not None and first <= frame < stop and name != video:
            del anchor[video]
            anchor[name] = frame


def _split_forbidden(data: Any, video: str, parts: Mapping[str, tuple[int, int]]) -> None:
    spans = data.get("forbidden") or []
    for span in [s for s in spans if s["video"] == video]:
        first, stop = span["frames"]
        inside = {n: (max(a, first), min(b, stop)) for n, (a, b) in parts.items()}
        for name, (a, b) in inside.items():
            if a < b:
                spans.append(flow({"video": name, "frames": [a, b]}))
        spans.remove(span)


FrameNumber = Annotated[int, Field(ge=0, le=LAST_FRAME, strict=True)]


class _Edit(BaseModel, ABC):
    model_config = ConfigDict(frozen=True, extra="forbid")

    @abstractmethod
    def apply(self, data: Any, counts: Counts) -> None:
        """Change the content of an action.yaml. ValueError when the edit does not fit it."""


class PersonEdit(_Edit):
    """Who performs in a video; None: the program decides."""

    kind: Literal["person"]
    video: Id
    person: Person | None

    def apply(self, data: Any, counts: Counts) -> None:
        put(_video_entry(data, self.video), "person", self.person and person_fields(self.person))


class FramesEdit(_Edit):
    """The used frames, first and one past the last; None: all."""

    kind: Literal["frames"]
    video: Id
    frames: tuple[FrameNumber, FrameNumber] | None

    def apply(self, data: Any, counts: Counts) -> None:
        entry, frames, count = _video_entry(data, self.video), self.frames, counts.get(self.video)
        if frames is not None and count is not None and frames[1] > count:
            raise ValueError(
                f"{self.video}: expected frames within [0, {count}], as the video has {count}, got "
                f"{list(frames)}"
            )
        whole = frames is None or (count is not None and frames == (0, count))
        put(entry, "frames", None if whole else frames and list(frames))


class MirroredEdit(_Edit):
    """Whether a video is a mirror image; None: the program decides."""

    kind: Literal["mirrored"]
    video: Id
    mirrored: bool | None

    def apply(self, data: Any, counts: Counts) -> None:
        put(_video_entry(data, self.video), "mirrored", self.mirrored)


class DetectEdit(_Edit):
    """People are to be detected in a video that has no keypoints."""

    kind: Literal["detect"]
    video: Id

    def apply(self, data: Any, counts: Counts) -> None:
        entry = _video_entry(data, self.video)
        if entry.get("keypoints") is not None:
            raise ValueError(f"{self.video} has keypoints already: {entry['keypoints']}")
        put(entry, "keypoints", DETECT)


class DropEdit(_Edit):
    """A video leaves the action, with its anchors and forbidden spans."""

    kind: Literal["drop"]
    video: Id

    def apply(self, data: Any, counts: Counts) -> None:
        if len(data["videos"]) == 1:
            raise ValueError(f"{self.video} is the only video; an action has at least one")
        data["videos"].remove(_video_entry(data, self.video))
        for anchor in data.get("anchors") or []:
            anchor.pop(self.video, None)
        _remove_items(data, "anchors", lambda anchor: len(anchor.keys() - {"hard"}) < 2)
        _remove_items(data, "forbidden", lambda span: span["video"] == self.video)


class SplitEdit(_Edit):
    """A video becomes several of one file; `starts`: the frames with which new ones begin."""

    kind: Literal["split"]
    video: Id
    starts: Annotated[list[FrameNumber], Field(min_length=1, max_length=500)]

    def apply(self, data: Any, counts: Counts) -> None:
        _split_video(data, self.video, self.starts, counts.get(self.video))


class AddAnchorEdit(_Edit):
    """Frames of at least two videos that show the same moment."""

    kind: Literal["add_anchor"]
    frames: Annotated[dict[Id, FrameNumber], Field(min_length=2)]
    hard: bool = False

    def apply(self, data: Any, counts: Counts) -> None:
        append(data, "anchors", flow({**self.frames, "hard": True} if self.hard else self.frames))


class AnchorEdit(_Edit):
    """Anchor `number`, from 0, becomes hard or not; None: it is removed."""

    kind: Literal["anchor"]
    number: Annotated[int, Field(ge=0)]
    hard: bool | None

    def apply(self, data: Any, counts: Counts) -> None:
        chosen = _item_of(data, "anchors", self.number, "anchor")
        if self.hard is None:
            _remove_items(data, "anchors", lambda anchor: anchor is chosen)
        elif self.hard:
            chosen["hard"] = True
        else:
            chosen.pop("hard", None)


class PerformersEdit(_Edit):
    """Who performs in every video, by name; None: one person in all of them."""

    kind: Literal["performers"]
    performers: Annotated[dict[Id, Id], Field(min_length=1)] | None

    def apply(self, data: Any, counts: Counts) -> None:
        if self.performers is None:
            for entry in data["videos"]:
                put(entry, "performer", None)
            return
        nameless = [e["id"] for e in data["videos"] if e["id"] not in self.performers]
        if nameless:
            names = ", ".join(nameless)
            raise ValueError(f"expected a performer of every video, got none of {names}")
        for video, performer in self.performers.items():
            put(_video_entry(data, video), "performer", performer)


class EventEdit(_Edit):
    """Whether all videos film one and the same performance."""

    kind: Literal["event"]
    event: bool

    def apply(self, data: Any, counts: Counts) -> None:
        put(data, "event", self.event if self.event or "event" in data else None)


class AddForbiddenEdit(_Edit):
    """Frames of a video, first and one past the last, that match nothing."""

    kind: Literal["add_forbidden"]
    video: Id
    frames: tuple[FrameNumber, FrameNumber]

    def apply(self, data: Any, counts: Counts) -> None:
        _video_entry(data, self.video)
        append(data, "forbidden", flow({"video": self.video, "frames": list(self.frames)}))


class ForbiddenEdit(_Edit):
    """Forbidden span `number`, from 0, is removed."""

    kind: Literal["forbidden"]
    number: Annotated[int, Field(ge=0)]

    def apply(self, data: Any, counts: Counts) -> None:
        chosen = _item_of(data, "forbidden", self.number, "forbidden span")
        _remove_items(data, "forbidden", lambda span: span is chosen)


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


def apply_edits(data: Any, edits: Sequence[Edit], counts: Counts) -> None:
    """Change the content of an action.yaml in place, which was valid before.

    ValueError with a sentence when an edit does not fit it.
    """
    for edit in edits:
        edit.apply(data, counts)
