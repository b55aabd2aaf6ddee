"""Takes cut into a film as editors do: transitions, replays, captions, mirrored and still shots."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from benchmarks.actions.captured_videos import data_folder
from benchmarks.collect_takes import Take, make_takes
from imocap_core.collect.listing import CollectedList, ListedOccurrence, ListedShot
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


# The compilations that are measured, and the examples of their actions.
#
# The defaults were chosen on other films: other actions, takes and transitions.

SERVE, KICK = "trials/tennis_serve_jarua", "trials/cmu_soccer_kick_s10"
WALK, OTHER_WALK = "trials/cmu_walk_s07", "performers/cmu_walk_s08"
JUMP = "trials/cmu_jump_s13"
ACTION_OF = {SERVE: "serve", KICK: "kick", WALK: "walk", OTHER_WALK: "walk"}
WALKED = (0, 66)  # frames
TAKES = {
    "serve 0": Take(SERVE, 0, 0, room=0),
    "serve 1": Take(SERVE, 1, 1, room=1),
    "serve 2": Take(SERVE, 2, 2, room=2),
    "serve 3": Take(SERVE, 3, 3, room=3),
    "serve 4": Take(SERVE, 5, 0, room=0),
    "slow serve": Take(SERVE, 6, 4, room=1, slow=4),
    "kick 0": Take(KICK, 0, 1, room=1),
    "kick 1": Take(KICK, 1, 2, room=2),
    "kick 2": Take(KICK, 2, 3, room=3),
    "kick 3": Take(KICK, 3, 0, room=0),
    "walk 0": Take(WALK, 0, 0, room=0),
    "walk 1": Take(WALK, 1, 1, room=1),
    "walk 2": Take(WALK, 2, 3, room=3),
    "walk 3": Take(WALK, 4, 0, room=0),
    "walk 4": Take(OTHER_WALK, 0, 0, room=0, performer=1),
    "walk 5": Take(OTHER_WALK, 1, 5, room=1, performer=1),
    "walk 6": Take(OTHER_WALK, 2, 2, room=2, performer=1),
    "talk 0": Take(SERVE, 0, 0, room=2, talks=True),
    "talk 1": Take(OTHER_WALK, 0, 6, room=3, performer=1, talks=True),
    "jump 0": Take(JUMP, 0, 1, room=2),
    "jump 1": Take(JUMP, 1, 8, room=0),
}
EXAMPLES = {
    "serve": Take(SERVE, 4, 3, room=1),
    "kick": Take(KICK, 4, 1, room=3),
    "walk": Take(WALK, 3, 1, room=2),
}


@dataclass(frozen=True)
class PlannedPiece:
    """A piece as it is planned: `source` names a take, or a real video of the data folder; None is
    blank."""

    source: str | None
    piece: Piece


def planned(source: str | None, into: str = "cut", frames: int = 0, **how: Any) -> PlannedPiece:
    """A piece of a source; `how`: the other fields of `Piece`."""
    return PlannedPiece(source, Piece(None, into, frames, **how))


BROADCAST = (
    planned(None, length=20),
    planned("talk 0", caption="INTERVIEW", zoom=1.6),
    planned("serve 0"),
    planned("slow serve", "wipe", 10, step=4),
    planned("slow serve", "wipe", 10, span=(60, 260), caption="REPLAY"),
    planned("balance_beam/cam01", "wipe", 12, step=2),
    planned("walk 0", "dissolve", 12),
    planned("kick 0"),
    planned("walk 4", "fade", 10),
    planned("serve 1", letterbox=True),
    planned(None, length=9),
    planned("jump 0"),
    planned("kick 1", "dissolve", 16),
    planned("kick 0", "dissolve", 8, span=(15, 60), repeat=4, caption="SLOW MOTION"),
    planned("serve 3", mirrored=True),
    planned("crowd/cam02", "dissolve", 20, step=2),
    planned("serve 4"),
    planned("walk 1", "wipe", 14),
    planned("talk 1", "fade", 8, caption="COACH"),
    planned("kick 2", zoom=1.2),
)
HIGHLIGHTS = (
    planned("walk 5"),
    planned("walk 2", "dissolve", 10),
    planned("serve 2"),
    planned("balance_beam/cam03", "fade", 12, step=2),
    planned("serve 0", still=40),
    planned("serve 0", "dissolve", 10, zoom=1.15),
    planned("kick 3"),
    planned("jump 1", "wipe", 8),
    planned("walk 3"),
    planned("slow serve", "dissolve", 14, span=(80, 240), letterbox=True, caption="1/4"),
    planned("walk 6", "fade", 15),
    planned(None, length=6, level=250),
    planned("kick 1", mirrored=True),
    planned("balance_beam/cam04", "wipe", 18, step=2),
    planned("talk 0", zoom=2.2),
    planned("walk 0", "dissolve", 10, span=(5, 55), repeat=2),
    planned("serve 1", "fade", 8),
    planned("kick 2", flash=30),
)


@dataclass(frozen=True)
class Compilation:
    """Films as lists of pieces, and of each action an example: a take that no film shows."""

    films: dict[str, list[Piece]]
    examples: dict[str, Path]


def reported_films(root: Path, folder: Path) -> Compilation:
    """Two films, 35 shots in all: serves, kicks and walks, and what is shown between them."""
    files = make_takes(root, folder / "takes", [*TAKES.values(), *EXAMPLES.values()])
    films = {"broadcast": BROADCAST, "highlights": HIGHLIGHTS}
    return Compilation(
        {name: [_piece(plan, root, files) for plan in plans] for name, plans in films.items()},
        {name: files[take] for name, take in EXAMPLES.items()},
    )


def _piece(plan: PlannedPiece, root: Path, files: Mapping[Take, Path]) -> Piece:
    """The piece with its file, and what it shows: the action and the take."""
    if plan.source is None:
        return plan.piece
    if plan.source not in TAKES:
        return replace(plan.piece, file=_real_video(root, plan.source))
    take = TAKES[plan.source]
    action = None if take.talks else ACTION_OF.get(take.file)
    shown = None if action is None else f"{action}/{take.name}"
    span = plan.piece.span or (WALKED if action == "walk" else None)
    return replace(plan.piece, file=files[take], shown=shown, span=span)


def _real_video(root: Path, name: str) -> Path:
    """A real video of the data folder, as `balance_beam/cam01`."""
    kind, camera = name.split("/")
    return data_folder(root, "trials").parent / kind / "videos" / f"{camera}.mp4"


# What a compilation shows, and how a list of what was collected from it compares.

NEAR = 2  # frames: a boundary is found if one is reported within so many of it
Boundary = tuple[int, int, str]  # first and one past the last frame of no shot, kind


@dataclass(frozen=True)
class Tally:
    """Counts of what is there, what of it was found, and what was found but is not there."""

    there: int
    found_right: int
    wrong: int

    @property
    def recall(self) -> float:
        """Share of what is there."""
        return self.found_right / self.there if self.there else float("nan")

    @property
    def precision(self) -> float:
        """Share of what was found that is right."""
        every = self.found_right + self.wrong
        return self.found_right / every if every else float("nan")


def true_boundaries(places: Sequence[CutPiece]) -> list[Boundary]:
    """Boundaries between the shots of a film; blank pieces are boundaries, not shots."""
    shots = [place for place in places if place.piece.file is not None]
    edges: list[Boundary] = [] if shots[0].first == 0 else [(0, shots[0].first, "black")]
    for a, b in pairwise(shots):
        between = [p for p in places if a.stop <= p.first and p.stop <= b.first and p not in (a, b)]
        edges.append((a.stop, b.first, "black" if between else b.piece.into))
    return edges


def boundary_tally(shots: Sequence[ListedShot], truth: Sequence[Boundary]) -> Tally:
    """How many of a film's boundaries were found."""
    reported = [(a.frames[1], b.frames[0]) for a, b in pairwise(shots)]
    if shots and shots[0].frames[0] > 0:
        reported.insert(0, (0, shots[0].frames[0]))
    unused = list(reported)
    right = 0
    for first, stop, _ in truth:
        near = [r for r in unused if r[0] <= stop + NEAR and r[1] >= first - NEAR]
        if near:
            unused.remove(near[0])
            right += 1
    return Tally(len(truth), right, len(unused))


def shown_by(occurrence: ListedOccurrence, places: Sequence[CutPiece]) -> CutPiece | None:
    """The piece that an occurrence is mostly of."""

    def shared(place: CutPiece) -> int:
        return min(place.stop, occurrence.frames[1]) - max(place.first, occurrence.frames[0])

    best = max(places, key=shared)
    return best if shared(best) > 0 else None


def action_of(place: CutPiece | None) -> str | None:
    """The action that a piece shows; None for none, and for a still picture."""
    if place is None or place.piece.shown is None or place.piece.still:
        return None
    return place.piece.shown.partition("/")[0]


def occurrence_tally(
    collected: CollectedList, films: Mapping[int, Sequence[CutPiece]], action: str
) -> Tally:
    """How many of the shots that show an action were found, and how many occurrences are others."""
    pieces = {(film, k) for film, places in films.items() for k, p in enumerate(places)
              if action_of(p) == action}  # fmt: skip
    hit: set[tuple[int, int]] = set()
    wrong = 0
    for occurrence in collected.occurrences:
        place = shown_by(occurrence, films[occurrence.film])
        if place is not None and action_of(place) == action:
            hit.add((occurrence.film, list(films[occurrence.film]).index(place)))
        else:
            wrong += 1
    return Tally(len(pieces), len(hit), wrong)


def replay_tally(collected: CollectedList, films: Mapping[int, Sequence[CutPiece]]) -> Tally:
    """How many pairs of occurrences that show one take are linked, and how many others are."""
    takes = {
        o.id: place.piece.shown if (place := shown_by(o, films[o.film])) is not None else None
        for o in collected.occurrences
    }
    shots = {o.id: (o.film, o.shot) for o in collected.occurrences}
    group = {o.id: o.same_take or o.id for o in collected.occurrences}
    there = right = wrong = 0
    for a, b in combinations(takes, 2):
        if shots[a] == shots[b]:
            continue
        same, linked = takes[a] is not None and takes[a] == takes[b], group[a] == group[b]
        there += same
        right += same and linked
        wrong += linked and not same
    return Tally(there, right, wrong)


def mirror_tally(
    collected: CollectedList, films: Mapping[int, Sequence[CutPiece]], action: str
) -> Tally:
    """How many of the mirrored occurrences of an action are marked, and how many others are."""
    there = right = wrong = 0
    for occurrence in collected.occurrences:
        place = shown_by(occurrence, films[occurrence.film])
        if place is None or action_of(place) != action:
            continue
        there += place.piece.mirrored
        right += place.piece.mirrored and occurrence.mirrored
        wrong += occurrence.mirrored and not place.piece.mirrored
    return Tally(there, right, wrong)
