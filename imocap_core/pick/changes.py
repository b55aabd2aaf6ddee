"""Edits applied to the content of an action.yaml, plain or with comments: pure functions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from imocap_core.pick.edits import (
    AddAnchorEdit,
    AddForbiddenEdit,
    AnchorEdit,
    DetectEdit,
    DropEdit,
    Edit,
    EventEdit,
    ForbiddenEdit,
    FramesEdit,
    MirroredEdit,
    PerformersEdit,
    PersonEdit,
    SplitEdit,
)
from imocap_core.pick.entries import flow, listed, put, remove_items, video_entry
from imocap_core.pick.splitting import split_video
from imocap_core.pipeline.action import DETECT
from imocap_core.pipeline.person import Person

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
