"""The arguments of `imocap sync`: keypoints, videos with keypoints beside them, or both in one."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imocap_core.errors import WrongUse
from imocap_core.pipeline.format_names import DetectionFormat, Layout

KEYPOINT_SUFFIXES = (".json", ".npz", ".csv", ".npy", ".tsv", ".jsonl")
# Where the keypoints of videos/clip.mp4 may be: folders of these names, and (but for the first)
# files of these names with one of the suffixes; {} is the video's name without its suffix.
KEYPOINT_PLACES = ("{}", "{}_keypoints", "{}_json", "keypoints/{}", "../keypoints/{}")


@dataclass(frozen=True)
class Declared:
    """What is known of all sources, where files do not say it. size: width, height, pixels."""

    format: DetectionFormat | None = None
    layout: Layout | None = None
    fps: float | None = None
    size: tuple[int, int] | None = None


@dataclass(frozen=True)
class VideoSource:
    """One video of the action to be made: the video file, or keypoints, or both."""

    video: Path | None
    keypoints: Path | None  # None: to be detected
    label: str | None = None  # its id; None: after the file

    @property
    def stem(self) -> str:
        """Its label, or the name of its file."""
        if self.label is not None:
            return self.label
        if self.video is not None:
            return self.video.stem
        return self.keypoints.name if self.keypoints is not None else ""


def sources_of(words: Sequence[str | VideoSource]) -> list[VideoSource]:
    """The videos and keypoints that the words name; sources as they are.

    A video beside which no keypoints lie has people detected in it. WrongUse when something is not
    there.
    """
    sources = []
    for word in words:
        if isinstance(word, VideoSource):
            sources.append(word)
            continue
        video, keypoints = _parts(word)
        if keypoints is None and video is not None:
            keypoints = _beside(video)
        sources.append(VideoSource(video, keypoints))
    return sources


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
    """The keypoints beside a video, in one of the usual places."""
    places = [video.parent / pattern.format(video.stem) for pattern in KEYPOINT_PLACES]
    folders = [p for p in places if p.is_dir() and any(p.glob("*.json"))]
    files = [p.with_name(p.name + suffix) for p in places[1:] for suffix in KEYPOINT_SUFFIXES]
    return next(iter([*folders, *(file for file in files if file.is_file())]), None)


def labels(sources: Sequence[VideoSource]) -> list[str]:
    """An id for each source: its name, or all numbered where one has no Latin letters or digits, or
    two have the same."""
    names = [ascii_name(source.stem) for source in sources]
    unique = len({name.lower() for name in names}) == len(names) and all(names)
    return names if unique else [f"v{i + 1}" for i in range(len(names))]


def ascii_name(words: str) -> str:
    """Words as an id or a name of an action: accents dropped, other characters as underscores;
    empty where hardly anything would remain."""
    plain = "".join(c for c in unicodedata.normalize("NFKD", words) if not unicodedata.combining(c))
    written = [c for c in plain if c.isalnum()]
    if 2 * sum(c.isascii() for c in written) <= len(written):
        return ""
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", plain).lstrip(".-")


def read_size(text: str | None) -> tuple[int, int] | None:
    """Width and height of '1920x1080'. WrongUse for other text."""
    if text is None:
        return None
    match = re.fullmatch(r"([1-9]\d*)[x, ]([1-9]\d*)", text.strip())
    if match is None:
        raise WrongUse(f"--size {text}: expected width x height in pixels, as in 1920x1080")
    return int(match[1]), int(match[2])
