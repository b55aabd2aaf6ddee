"""Whether a file can be captured from, before any work is done."""

from __future__ import annotations

from collections import deque
from pathlib import Path

from imocap_core.io.video import VideoInfo, open_video, probe, read_gray
from imocap_core.limits import LEAST_FRAMES

BEGINNING_BYTES = 1024
FASTEST_FPS = 1000.0  # of a film of a person; above it the stamps are wrong
LOOK_SCALE = 0.05  # of the pictures, which are decoded only to see whether they can be
PICTURE, TEXT = "a picture", "text"
PICTURE_BEGINNINGS = (b"\xff\xd8\xff", b"\x89PNG", b"BM", b"II*\0", b"MM\0*")


def check_video(path: Path) -> VideoInfo:
    """Frame rate, size and frame count of a video that has a motion.

    ValueError for a file that is empty, text, a picture, audio, cut short, of another kind than
    video, of wrong time stamps, or of fewer than LEAST_FRAMES frames.
    """
    other = _other_kind(path)
    if other is not None:
        raise ValueError(f"{path}: expected a video, got {other}")
    info = probe(path)
    if info.fps > FASTEST_FPS:
        raise ValueError(
            f"{path}: its time stamps say {info.fps:,.0f} frames a second; convert it to its true "
            f"frame rate first"
        )
    if info.frame_count < LEAST_FRAMES:
        raise ValueError(
            f"{path}: expected at least {LEAST_FRAMES} frames, as fewer have no motion, got "
            f"{info.frame_count}; give a longer clip"
        )
    return info


def decode_whole(video: Path) -> None:
    """Decode a video to its end: a second for some hundred pictures. ValueError where it breaks
    off."""
    deque(read_gray(video, scale=LOOK_SCALE), maxlen=0)


def why_not_detected(video: Path) -> str:
    """Why the detector passed a video over."""
    try:
        decode_whole(video)
    except ValueError as error:
        return str(error)
    return f"{video}: it has no detections; run again"


def _other_kind(path: Path) -> str | None:
    """What a file is by its first bytes, with what to do; None for what may be a video."""
    if not path.is_file():
        return None
    with path.open("rb") as file:
        beginning = file.read(BEGINNING_BYTES)
    if not beginning:
        return "an empty file; copy or download it again"
    if _is_text(beginning):
        return TEXT
    try:
        open_video(path).close()
    except ValueError:
        if beginning.startswith(PICTURE_BEGINNINGS):
            return PICTURE
        if beginning[4:8] == b"ftyp":
            return "one cut short: the index at its end is missing; copy or download it again"
        raise
    return None


def _is_text(beginning: bytes) -> bool:
    """Whether bytes are UTF-8 without control characters; a character may be cut at the end."""
    try:
        text = beginning.decode("utf-8", errors="strict")
    except UnicodeDecodeError as error:
        if error.start < len(beginning) - 3:
            return False
        text = beginning[: error.start].decode()
    return all(letter.isprintable() or letter in "\t\r\n\f" for letter in text)
