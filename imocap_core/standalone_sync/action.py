"""The action that `imocap sync` makes of its arguments: artifacts/NAME/action.yaml."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any

import yaml

from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.io.detectors.guess import guess_detections
from imocap_core.pipeline.action import DETECT, FILE_NAME, Action, Declaration, check_name
from imocap_core.pipeline.declared_paths import declared_path
from imocap_core.standalone_sync.sources import Declared, VideoSource, labels
from imocap_core.whole_files import write_whole

HEAD = "# Written by imocap, which writes it again; copy it to actions/ to change it.\n"


def write_sources(
    root: Path, name: str | None, sources: Sequence[VideoSource], declared: Declared
) -> Path:
    """The folder of an action of these sources, made or brought up to date.

    WorkFailed when keypoints are not understood, WrongUse when fps and size are missing or the
    name is taken.
    """
    blind = [str(s.keypoints) for s in sources if s.video is None]
    if blind and (declared.fps is None or declared.size is None):
        raise WrongUse(
            f"{', '.join(blind)}: without a video, frame rate and picture size of "
            f"keypoints are unknown; give both, as in --fps 30 --size 1920x1080"
        )
    names = labels(sources)
    folder = results_folder(root, name or default_name("sync-", names, sources))
    videos = [
        _declaration(label, source, declared, folder)
        for label, source in zip(names, sources, strict=True)
    ]
    return write(folder, videos)


def write_instances(
    root: Path, action: Action, name: str, spans: Mapping[str, Sequence[tuple[int, int]]]
) -> Path:
    """The folder of an action in which some videos are replaced by parts (first, stop) of them."""
    folder = results_folder(root, name)
    videos = []
    for video in action.videos:
        whole = video.model_copy(update={"repetitions": None})
        if video.id not in spans:
            videos.append(_moved(whole, action.folder, folder))
            continue
        for number, frames in enumerate(spans[video.id], start=1):
            part = whole.model_copy(update={"id": f"{video.id}_r{number}", "frames": frames})
            videos.append(_moved(part, action.folder, folder))
    return write(folder, videos, action.params)


def write(
    folder: Path, videos: Sequence[dict[str, Any]], params: dict[str, Any] | None = None
) -> Path:
    """folder/action.yaml with these videos; untouched when it is equal."""
    content: dict[str, Any] = {"name": folder.name, "videos": list(videos)}
    if params:
        content["params"] = params
    text = HEAD + yaml.safe_dump(content, sort_keys=False)
    file = folder / FILE_NAME
    if not (file.is_file() and file.read_text(encoding="utf-8") == text):
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(file, text)
    return folder


def results_folder(root: Path, name: str) -> Path:
    """artifacts/NAME; WrongUse when the name is invalid or another action's results are there."""
    check_name(name)
    folder = root / "artifacts" / name
    file = folder / FILE_NAME
    ours = file.is_file() and file.read_text(encoding="utf-8").startswith(HEAD)
    taken = (root / "actions" / name).exists() or (folder.is_dir() and any(folder.iterdir()))
    if taken and not ours:
        raise WrongUse(f"there is another action {name}; choose another name with --name")
    return folder


def default_name(prefix: str, names: Sequence[str], sources: Sequence[VideoSource]) -> str:
    """The common beginning of the names, and a few letters that differ for other sources."""
    same = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    shared = "".join(letters[0] for letters in same)
    paths = [str(path.resolve()) for s in sources for path in (s.video, s.keypoints) if path]
    digest = hashlib.sha256("\n".join(paths).encode()).hexdigest()[:6]
    word = shared.rstrip("0123456789_.-") or "videos"
    return f"{prefix}{word}-{digest}"


def _declaration(
    label: str, source: VideoSource, declared: Declared, folder: Path
) -> dict[str, Any]:
    if source.keypoints is None:
        assert source.video is not None
        return {"id": label, "video": declared_path(source.video, folder), "keypoints": DETECT}
    try:
        if declared.format is not None and declared.layout is not None:
            kind, layout = str(declared.format), str(declared.layout)
        else:
            kind, layout = guess_detections(source.keypoints, layout=declared.layout)
    except ValueError as error:
        raise WorkFailed(str(error)) from None
    entry: dict[str, Any] = {"id": label}
    if source.video is not None:
        entry["video"] = declared_path(source.video, folder)
    entry |= {
        "keypoints": declared_path(source.keypoints, folder),
        "format": declared.format or kind,
    }
    entry["layout"] = layout
    if source.video is None and declared.fps is not None and declared.size is not None:
        entry |= {"fps": declared.fps, "size": list(declared.size)}
    return entry


def _moved(declaration: Declaration, old: Path, new: Path) -> dict[str, Any]:
    """A declaration whose paths are relative to another folder."""
    entry = declaration.model_dump(mode="json", exclude_none=True, by_alias=True)
    for field in ("video", "keypoints", "initial"):
        if entry.get(field, DETECT) != DETECT:
            entry[field] = declared_path(old / entry[field], new)
    return entry
