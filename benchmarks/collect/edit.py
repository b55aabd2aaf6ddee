"""Takes cut into a film as editors do: transitions, replays, captions, mirrored and still shots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from imocap_core.io.video import read_rgb, write_h264

SIZE = (640, 360)
FPS = 30.0
CRF = 23
LETTERBOX = 40  # rows of each bar

Picture = UInt8[np.ndarray, "H W 3"]


@dataclass(frozen=True)
class Piece:
    """A shot as it is cut: of a film file, or of one grey level (black, white).

    into: how it begins: cut, dissolve, wipe or fade (through black), over so many `frames`. span:
    of the file's frames. repeat: each picture is shown so often (slow motion without more
    pictures); step: every so many pictures. shown: what it is of, for the truth; None: no action.
    pan: pixels a frame by which the picture moves sideways. flash: frame that is white.
    """

    file: Path | None
    into: str = "cut"
    frames: int = 0
    span: tuple[int, int] | None = None
    repeat: int = 1
    step: int = 1
    mirrored: bool = False
    caption: str = ""
    letterbox: bool = False
    zoom: float = 1.0
    still: int = 0
    level: int = 0
    length: int = 0
    pan: float = 0.0
    flash: int | None = None
    shown: str | None = None


@dataclass(frozen=True)
class CutPiece:
    """Where a piece is in the film: its frames without those of the transitions about it."""

    piece: Piece
    first: int
    stop: int
    source_first: int  # the piece's picture that `first` shows


def write_film(file: Path, pieces: Sequence[Piece]) -> list[CutPiece]:
    """Write the film of some pieces; where each one is in it."""
    places: list[CutPiece] = []
    write_h264(file, _cut(pieces, places), FPS, crf=CRF)
    return places


def film_places(pieces: Sequence[Piece]) -> list[CutPiece]:
    """Where each piece is in the film of some pieces, which is not written."""
    places: list[CutPiece] = []
    for _ in _cut(pieces, places):
        pass
    return places


def _cut(pieces: Sequence[Piece], places: list[CutPiece]) -> Iterator[Picture]:
    """The film's pictures; `places` is filled on the way. A dissolve or wipe shows the end of one
    piece and the beginning of the next together."""
    number, tail = 0, list[Picture]()
    for k, piece in enumerate(pieces):
        pictures = list(_pictures(piece))
        shared = piece.frames if piece.into in ("dissolve", "wipe") else 0
        for i in range(shared):
            yield _mixed(tail[i], pictures[i], (i + 1) / (shared + 1), piece.into)
        number += shared
        dark = piece.frames if piece.into == "fade" else 0
        for i in range(dark):
            yield np.rint(pictures[i] * ((i + 1) / (dark + 1))).astype(np.uint8)
        number += dark
        following = pieces[k + 1] if k + 1 < len(pieces) else None
        out = 0 if following is None or following.into == "cut" else following.frames
        body = pictures[shared + dark : len(pictures) - out]
        places.append(CutPiece(piece, number, number + len(body), shared + dark))
        yield from body
        number += len(body)
        tail = pictures[len(pictures) - out :]
        if following is not None and following.into == "fade":
            for i, picture in enumerate(tail):
                yield np.rint(picture * (1 - (i + 1) / (out + 1))).astype(np.uint8)
            number += out


def _mixed(a: Picture, b: Picture, share: float, kind: str) -> Picture:
    if kind == "dissolve":
        return np.rint((1 - share) * a.astype(float) + share * b).astype(np.uint8)
    edge = round(share * a.shape[1])
    return np.concatenate([b[:, :edge], a[:, edge:]], axis=1)


def _pictures(piece: Piece) -> Iterator[Picture]:
    if piece.file is None:
        blank = np.full((SIZE[1], SIZE[0], 3), piece.level, np.uint8)
        yield from [blank] * piece.length
        return
    first, stop = piece.span or (0, None)
    count = 0
    for number, picture in read_rgb(piece.file, first, stop):
        if (number - first) % piece.step:
            continue
        for _ in range(piece.repeat if not piece.still else piece.still):
            yield _dressed(picture, piece, count)
            count += 1
        if piece.still:
            return


def _dressed(picture: Picture, piece: Piece, number: int) -> Picture:
    """The picture on the film's canvas, as the piece says."""
    if piece.flash is not None and number == piece.flash:
        return np.full((SIZE[1], SIZE[0], 3), 250, np.uint8)
    if piece.mirrored:
        picture = picture[:, ::-1]
    canvas = _placed(picture, piece.zoom, round(piece.pan * (number - 25)))
    if piece.letterbox:
        canvas[:LETTERBOX] = canvas[-LETTERBOX:] = 0
    if piece.caption:
        cv2.rectangle(canvas, (60, SIZE[1] - 60), (SIZE[0] - 60, SIZE[1] - 25), (30, 30, 160), -1)
        where, white = (80, SIZE[1] - 35), (255, 255, 255)
        cv2.putText(canvas, piece.caption, where, cv2.FONT_HERSHEY_SIMPLEX, 0.7, white, 1)
    return canvas


def _placed(picture: Picture, zoom: float, shift: int) -> Picture:
    """Scaled to the canvas's height (times zoom), in its middle; black bars beside it."""
    height, width = picture.shape[:2]
    scale = zoom * SIZE[1] / height
    area = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    scaled = cv2.resize(picture, (round(width * scale), round(height * scale)), interpolation=area)
    right, down = (SIZE[0] - scaled.shape[1]) / 2 + shift, SIZE[1] - scaled.shape[0]
    move = np.array([[1, 0, right], [0, 1, down]], dtype=np.float32)
    return np.asarray(cv2.warpAffine(scaled, move, SIZE), np.uint8)
