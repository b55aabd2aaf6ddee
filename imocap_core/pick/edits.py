"""The edits of an action.yaml that the page can ask for, applied to its content."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from imocap_core.identifiers import Id
from imocap_core.limits import LAST_FRAME
from imocap_core.pipeline.action import DETECT, Person


def video_entry(data: Any, video: str) -> Any:
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


def remove_items(data: Any, field: str, unwanted: Callable[[Any], bool]) -> None:
    """Remove items of a list; the field goes with the last one."""
    items = data.get(field) or []
    for n in reversed([n for n, item in enumerate(items) if unwanted(item)]):
        del items[n]
    if field in data and not items:
        del data[field]


def listed(data: Any, item: Any) -> Any:
    """A list of one item for a field of `data`, an item a line."""
    return CommentedSeq([item]) if isinstance(data, CommentedMap) else [item]


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


def split_video(data: Any, video: str, starts: Sequence[int], count: int | None) -> None:
    """Split a video where new ones begin; the first part keeps its id.

    ValueError when a place is outside the used frames.
    """
    entry = video_entry(data, video)
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
        _leave_person(part, span)
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


def _leave_person(part: dict[str, Any], span: tuple[int, int]) -> None:
    """Without the performer of other frames, or by a number, which another part may not have."""
    person = part.get("person")
    if person is not None and (person.get("track") or not _person_is_in(part, span)):
        del part["person"]


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


Counts = Mapping[str, int]
"""Frames of each video's file, where they are counted."""


def apply_edits(data: Any, edits: Sequence[Edit], counts: Counts) -> None:
    """Change the content of an action.yaml in place, which was valid before.

    ValueError with a sentence when an edit does not fit it.
    """
    for edit in edits:
        match edit:
            case PersonEdit():
                person = edit.person and person_fields(edit.person)
                put(video_entry(data, edit.video), "person", person)
            case FramesEdit():
                _put_frames(video_entry(data, edit.video), edit.frames, counts.get(edit.video))
            case MirroredEdit():
                put(video_entry(data, edit.video), "mirrored", edit.mirrored)
            case DetectEdit():
                _put_detect(video_entry(data, edit.video))
            case DropEdit():
                _drop(data, edit.video)
            case SplitEdit():
                split_video(data, edit.video, edit.starts, counts.get(edit.video))
            case _:
                _apply_to_action(data, edit)


def _apply_to_action(data: Any, edit: Edit) -> None:
    """An edit of what belongs to several videos: performers, moments, one event."""
    match edit:
        case AddAnchorEdit():
            _add_anchor(data, dict(edit.frames), edit.hard)
        case AnchorEdit():
            _change_anchor(data, edit.number, edit.hard)
        case PerformersEdit():
            _put_performers(data, edit.performers)
        case EventEdit():
            put(data, "event", edit.event if edit.event or "event" in data else None)
        case AddForbiddenEdit():
            _add_forbidden(data, edit.video, edit.frames)
        case ForbiddenEdit():
            _remove_forbidden(data, edit.number)


def person_fields(person: Person) -> dict[str, Any]:
    """As a person's declaration is written: whole pixels without a decimal point."""
    fields = person.model_dump(mode="json", by_alias=True, exclude_none=True)
    for name in fields.keys() & {"at", "box"}:
        fields[name] = [int(v) if v == int(v) else v for v in fields[name]]
    return fields


def _put_frames(entry: Any, frames: tuple[int, int] | None, count: int | None) -> None:
    if frames is not None and count is not None and frames[1] > count:
        raise ValueError(
            f"{entry['id']}: expected frames within [0, {count}], as the video has {count}, got "
            f"{list(frames)}"
        )
    whole = frames is None or (count is not None and frames == (0, count))
    put(entry, "frames", None if whole else frames and list(frames))


def _put_detect(entry: Any) -> None:
    if entry.get("keypoints") is not None:
        raise ValueError(f"{entry['id']} has keypoints already: {entry['keypoints']}")
    put(entry, "keypoints", DETECT)


def _drop(data: Any, video: str) -> None:
    if len(data["videos"]) == 1:
        raise ValueError(f"{video} is the only video; an action has at least one")
    data["videos"].remove(video_entry(data, video))
    for anchor in data.get("anchors") or []:
        anchor.pop(video, None)
    remove_items(data, "anchors", lambda anchor: len(_frames_of(anchor)) < 2)
    remove_items(data, "forbidden", lambda span: span["video"] == video)


def _frames_of(anchor: Any) -> dict[str, int]:
    return {video: frame for video, frame in anchor.items() if video != "hard"}


def _add_anchor(data: Any, frames: dict[str, int], hard: bool) -> None:
    _append(data, "anchors", flow({**frames, "hard": True} if hard else frames))


def _append(data: Any, field: str, item: Any) -> None:
    if data.get(field):
        data[field].append(item)
    else:
        data[field] = listed(data, item)


def _change_anchor(data: Any, number: int, hard: bool | None) -> None:
    anchors = data.get("anchors") or []
    if number >= len(anchors):
        raise ValueError(f"there is no anchor {number + 1} in action.yaml")
    chosen = anchors[number]
    if hard is None:
        remove_items(data, "anchors", lambda anchor: anchor is chosen)
    elif hard:
        chosen["hard"] = True
    else:
        chosen.pop("hard", None)


def _put_performers(data: Any, performers: Mapping[str, str] | None) -> None:
    if performers is None:
        for entry in data["videos"]:
            put(entry, "performer", None)
        return
    nameless = [entry["id"] for entry in data["videos"] if entry["id"] not in performers]
    if nameless:
        raise ValueError(f"expected a performer of every video, got none of {', '.join(nameless)}")
    for video, performer in performers.items():
        put(video_entry(data, video), "performer", performer)


def _add_forbidden(data: Any, video: str, frames: tuple[int, int]) -> None:
    video_entry(data, video)
    _append(data, "forbidden", flow({"video": video, "frames": list(frames)}))


def _remove_forbidden(data: Any, number: int) -> None:
    spans = data.get("forbidden") or []
    if number >= len(spans):
        raise ValueError(f"there is no forbidden span {number + 1} in action.yaml")
    chosen = spans[number]
    remove_items(data, "forbidden", lambda span: span is chosen)
