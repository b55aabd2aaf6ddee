"""What `imocap sync` is given: keypoints, videos with keypoints, or both in one word."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imocap_core.errors import WrongUse
from imocap_core.pipeline.action import DetectionFormat, Layout

KEYPOINT_SUFFIXES = (".json", ".npz", ".csv", ".h5")
# Where keypoints of videos/clip.mp4 are looked for: folders of these names, and (but for the first)
# files of these names with one of the suffixes; {} is the video's name without its suffix.
BESIDE = ("{}", "{}_keypoints", "{}_json", "keypoints/{}", "../keypoints/{}")


@dataclass(frozen=True)
class Given:
    """What the options say of every source, where the files don't."""

    format: DetectionFormat | None = None
    layout: Layout | None = None
    fps: float | None = None
    size: tuple[int, int] | None = None


@dataclass(frozen=True)
class Source:
    """One video of the action to be: the film, or keypoints, or both."""

    video: Path | None
    keypoints: Path | None  # None: to be detected

    @property
    def stem(self) -> str:
        """What it is called."""
        if self.video is not None:
            return self.video.stem
        return self.keypoints.name if self.keypoints is not None else ""


def sources_of(words: Sequence[str]) -> list[Source]:
    """The videos and keypoints that the words name.

    A video beside which no keypoints lie has people detected in it. WrongUse when something is not
    there.
    """
    found = []
    for word in words:
        video, keypoints = _parts(word)
        if keypoints is None and video is not None:
            keypoints = _beside(video)
        found.append(Source(video, keypoints))
    return found


def _parts(word: str) -> tuple[Path | None, Path | None]:
    """(video, keypoints) of one word."""
    path = Path(word)
    if path.is_dir() or (path.is_file() and path.suffix.lower() in KEYPOINT_SUFFIXES):
        return None, path
    if path.is_file():
        return path, None
    video, colon, keypoints = word.rpartition(":")
    if colon and Path(video).is_file():
        if not Path(keypoints).exists():
            raise WrongUse(f"{word}: there is no {keypoints or 'folder after the colon'}")
        return Path(video), Path(keypoints)
    raise WrongUse(
        f"there is no {video if colon else word}; expected keypoints (a folder or file), a video "
        f"with keypoints beside it, VIDEO:KEYPOINTS, or an action"
    )


def _beside(video: Path) -> Path | None:
    """The keypoints of a video, where people put them."""
    places = [video.parent / pattern.format(video.stem) for pattern in BESIDE]
    folders = [p for p in places if p.is_dir() and any(p.glob("*.json"))]
    files = [p.with_name(p.name + suffix) for p in places[1:] for suffix in KEYPOINT_SUFFIXES]
    return next(iter([*folders, *(file for file in files if file.is_file())]), None)


def labels(sources: Sequence[Source]) -> list[str]:
    """An id for each source: its name, or its number where that is no id or not unique."""
    names = [re.sub(r"[^A-Za-z0-9_.-]", "_", source.stem) for source in sources]
    unique = len(set(names)) == len(names) and all(re.match(r"[A-Za-z0-9_]", n) for n in names)
    return names if unique else [f"v{i + 1}" for i in range(len(names))]


def read_size(text: str | None) -> tuple[int, int] | None:
    """Width and height of '1920x1080'. WrongUse when it is none."""
    if text is None:
        return None
    match = re.fullmatch(r"([1-9]\d*)[x, ]([1-9]\d*)", text.strip())
    if match is None:
        raise WrongUse(f"--size {text}: expected width x height in pixels, as in 1920x1080")
    return int(match[1]), int(match[2])
