"""Occurrences of the action, which of them become videos; collected.json and action.yaml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from jaxtyping import Float
from pydantic import BaseModel, ConfigDict

from imocap_core.collect.films import ShotTrack
from imocap_core.collect.matching import Match
from imocap_core.collect.shots import Shot
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.files import write_whole
from imocap_core.identifiers import Id
from imocap_core.params import CollectParams
from imocap_core.people.tracking import box_overlap
from imocap_core.pipeline.action import DETECT
from imocap_core.pipeline.action import FILE_NAME as ACTION_FILE

Box = tuple[float, float, float, float]  # left, top, right, bottom

SAME = 0.5  # of the shorter in time, and of both boxes: two tracks of one person
SIZE_PX = 150.0  # a person of this size counts half as much as one of any size
SIDES = ("front", "left side", "back", "right side")
ACROSS = [
    (SMPL_JOINTS.index(f"left_{x}"), SMPL_JOINTS.index(f"right_{x}")) for x in ("hip", "shoulder")
]


@dataclass(frozen=True)
class Occurrence:
    """One performance of the action in a film.

    film, shot, track: indices (track: rank in its shot). first, stop: frames of the film, with a
    margin. rate: speed, times the template's. azimuth_deg: of the camera about the performer, 0 in
    front, 90 at the left. height_px: diagonal of the person's box. visible: share of its frames
    with the person; confidence: mean of the keypoints'. box_px: in the frame `box_frame`. alone:
    nobody else is followed in the shot.
    """

    film: int
    shot: int
    track: int
    first: int
    stop: int
    rate: float
    score: float
    mirrored: bool
    mirror_margin: float
    azimuth_deg: float
    height_px: float
    visible: float
    confidence: float
    box_px: Box
    box_frame: int
    alone: bool

    @property
    def quality(self) -> float:
        """Likeness, visibility and size in one number, at most 1; slow motion loses a little."""
        size = self.height_px / (self.height_px + SIZE_PX)
        slow = min(self.rate, 1.0) ** 0.25
        return max(self.score, 0.0) * self.visible * self.confidence * size * slow

    @property
    def view(self) -> str:
        """The performer's side that the camera sees."""
        return SIDES[round(self.azimuth_deg / 90.0) % 4]


def occurrence_of(
    match: Match, track: ShotTrack, shot: Shot, margin_s: float, *, alone: bool
) -> Occurrence:
    """A match as an occurrence, with a margin as far as the track and its shot reach."""
    margin = round(margin_s * track.fps)
    first = max(track.first + match.first - margin, shot.first, track.first)
    stop = min(track.first + match.stop + margin, shot.stop, track.stop)
    rows = slice(match.first, match.stop)
    shown = np.isfinite(track.box_px[rows]).all(axis=1)
    boxes = track.box_px[rows][shown]
    middle = np.flatnonzero(shown)[shown.sum() // 2] if shown.any() else 0
    box = track.box_px[match.first + middle]
    azimuth = _azimuth_deg(track.joints[rows])
    heights = np.hypot(boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1])
    x0, y0, x1, y1 = (round(float(x), 1) for x in box)
    return Occurrence(
        film=track.film,
        shot=track.shot,
        track=track.track,
        first=first,
        stop=stop,
        rate=match.rate,
        score=match.score,
        mirrored=match.mirrored,
        mirror_margin=match.mirror_margin,
        azimuth_deg=-azimuth % 360 if match.mirrored else azimuth,
        height_px=float(np.median(heights)) if len(heights) else 0.0,
        visible=float(shown.mean()),
        confidence=float(track.confidence[rows][shown].mean()) if shown.any() else 0.0,
        box_px=(x0, y0, x1, y1),
        box_frame=track.first + match.first + int(middle),
        alone=alone,
    )


def _azimuth_deg(joints: Float[np.ndarray, "T 24 3"]) -> float:
    """Mean direction from which the performer is filmed, from 0 to 360."""
    across = sum(joints[:, left] - joints[:, right] for left, right in ACROSS)
    flat = np.asarray(across)[:, [0, 2]]
    flat = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-6)
    x, z = flat.mean(axis=0)
    return float(np.degrees(np.arctan2(-z, x)) % 360)


def shows_same(a: Occurrence, b: Occurrence) -> bool:
    """Whether two tracks of one shot show the same person at the same time."""
    if (a.film, a.shot) != (b.film, b.shot) or a.track == b.track:
        return False
    shared = min(a.stop, b.stop) - max(a.first, b.first)
    together = shared > SAME * min(a.stop - a.first, b.stop - b.first)
    return together and box_overlap(np.array(a.box_px), np.array(b.box_px)) > SAME


def _view_difference_deg(a: Occurrence, b: Occurrence) -> float:
    """Angle between the directions of two views, at most 180."""
    return abs((a.azimuth_deg - b.azimuth_deg + 180) % 360 - 180)


LEAST_S = 0.4  # a shorter one has too little motion
_LEAST_VISIBLE = 0.8  # share of the frames in which the person must be detected
_VIEW_DEG = 30.0  # directions that differ by less show the same view


@dataclass(frozen=True)
class SameTakeAs:
    """An occurrence shows the take of another one, `rate` times as fast."""

    other: int
    rate: float


@dataclass(frozen=True)
class Decision:
    """Whether an occurrence becomes a video, and if not, why. same_take: of which it is a showing
    again."""

    chosen: bool
    reason: str = ""
    same_take: SameTakeAs | None = None


def decide(
    occurrences: Sequence[Occurrence],
    showings: Mapping[int, SameTakeAs],
    names: Sequence[str],
    fps: Sequence[float],
    params: CollectParams,
) -> list[Decision]:
    """A decision on every occurrence.

    Args:
        showings: occurrences that show a take again, by index, and the showing that stays.
        names: of the occurrences, for the reasons. fps: of their films.
    """
    decisions: dict[int, Decision] = {}
    usable = []
    for i, occurrence in enumerate(occurrences):
        fault = _fault(occurrence, fps[i], params)
        if i in showings:
            decisions[i] = Decision(False, _showing(showings[i], names), showings[i])
        elif fault:
            decisions[i] = Decision(False, fault)
        else:
            usable.append(i)
    ranked = _by_view(occurrences, usable)
    for place, i in enumerate(ranked):
        reason = "" if place < params.keep else _less(occurrences, ranked, i, names, params)
        decisions[i] = Decision(place < params.keep, reason)
    return [decisions[i] for i in range(len(occurrences))]


def _fault(occurrence: Occurrence, fps: float, params: CollectParams) -> str:
    if occurrence.height_px < params.least_height_px:
        return f"too small: {occurrence.height_px:.0f} px"
    if (occurrence.stop - occurrence.first) / fps < LEAST_S:
        return f"too short: {(occurrence.stop - occurrence.first) / fps:.1f} s"
    if occurrence.visible < _LEAST_VISIBLE:
        return f"the person is detected in {occurrence.visible:.0%} of it only"
    return ""


def _showing(same: SameTakeAs, names: Sequence[str]) -> str:
    if 0.85 < same.rate < 1.18:
        return f"duplicate of {names[same.other]}"
    return f"replay of {names[same.other]} at {same.rate:.2g} times its speed"


def _by_view(occurrences: Sequence[Occurrence], usable: Sequence[int]) -> list[int]:
    """The usable ones in the order in which they are taken: the best one of each view, then the
    second best of each, and so on."""
    placed: list[tuple[int, float, int]] = []
    for i in sorted(usable, key=lambda k: -occurrences[k].quality):
        near = [
            k
            for _, _, k in placed
            if _view_difference_deg(occurrences[i], occurrences[k]) < _VIEW_DEG
        ]
        placed.append((len(near), -occurrences[i].quality, i))
    return [i for _, _, i in sorted(placed)]


def _less(
    occurrences: Sequence[Occurrence],
    ranked: Sequence[int],
    i: int,
    names: Sequence[str],
    params: CollectParams,
) -> str:
    near = [
        names[k]
        for k in ranked[: params.keep]
        if _view_difference_deg(occurrences[i], occurrences[k]) < _VIEW_DEG
    ]
    if near:
        return f"less visible than others of that view ({', '.join(near)})"
    return f"more than {params.keep} occurrences (collect.keep)"


FILE_NAME = "collected.json"


class _Listed(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class ListedShot(_Listed):
    """A shot: its number in the film, from 1; first and one past the last frame; the kinds of its
    boundaries; how many people are followed; what became of it."""

    number: int
    frames: tuple[int, int]
    seconds: tuple[float, float]
    begins: str
    ends: str
    people: int
    outcome: str


class ListedFilm(_Listed):
    """A film: its path from the folder of the list, and its shots."""

    video: str
    fps: float
    size: tuple[int, int]
    frame_count: int
    shots: list[ListedShot]


class ListedOccurrence(_Listed):
    """An occurrence of the action. film: index. speed, score: times the template's, at most 1.

    same_take: the occurrence that shows the same take, same_take_speed times as fast.
    """

    id: Id
    film: int
    shot: int
    frames: tuple[int, int]
    seconds: tuple[float, float]
    track: int
    box_px: tuple[float, float, float, float]
    box_frame: int
    view: str
    azimuth_deg: float
    height_px: float
    visible: float
    speed: float
    score: float
    quality: float
    mirrored: bool
    mirror_margin: float
    chosen: bool
    reason: str
    same_take: str | None = None
    same_take_speed: float | None = None


class ListedTemplate(_Listed):
    """The movement that was looked for: given as an example, or the dominant one."""

    video: str
    frames: tuple[int, int]
    seconds: tuple[float, float]
    given: bool


class CollectedList(_Listed):
    """The content of collected.json."""

    format: Literal[1] = 1
    name: Id
    template: ListedTemplate
    films: list[ListedFilm]
    occurrences: list[ListedOccurrence]

    @property
    def chosen(self) -> list[ListedOccurrence]:
        """The occurrences that are videos of the action."""
        return [occurrence for occurrence in self.occurrences if occurrence.chosen]


def write_collected(file: Path, collected: CollectedList) -> None:
    """Write the list, whole or not at all."""
    write_whole(file, collected.model_dump_json(indent=1) + "\n")


def seconds(frames: tuple[int, int], fps: float) -> tuple[float, float]:
    """Frames as times, to the hundredth."""
    return round(frames[0] / fps, 2), round(frames[1] / fps, 2)


def occurrence_names(occurrences: Sequence[Occurrence], labels: Sequence[str]) -> list[str]:
    """An id for each: the film's label, the shot's number, a letter where a shot has several."""
    names: list[str] = []
    for i, occurrence in enumerate(occurrences):
        shot = (occurrence.film, occurrence.shot)
        before = sum((o.film, o.shot) == shot for o in occurrences[:i])
        letter = "" if before == 0 else chr(ord("a") + before) if before < 26 else f"_{before}"
        film = f"{labels[occurrence.film]}_" if len(labels) > 1 else ""
        names.append(f"{film}s{occurrence.shot + 1:03d}{letter}")
    return names


def listed_occurrence(
    name: str, occurrence: Occurrence, decision: Decision, names: Sequence[str], fps: float
) -> ListedOccurrence:
    """One row of the list."""
    frames = (occurrence.first, occurrence.stop)
    same = decision.same_take
    return ListedOccurrence(
        id=name,
        film=occurrence.film,
        shot=occurrence.shot + 1,
        frames=frames,
        seconds=seconds(frames, fps),
        track=occurrence.track + 1,
        box_px=occurrence.box_px,
        box_frame=occurrence.box_frame,
        view=occurrence.view,
        azimuth_deg=round(occurrence.azimuth_deg, 1),
        height_px=round(occurrence.height_px, 1),
        visible=round(occurrence.visible, 3),
        speed=round(occurrence.rate, 3),
        score=round(occurrence.score, 3),
        quality=round(occurrence.quality, 3),
        mirrored=occurrence.mirrored,
        mirror_margin=round(occurrence.mirror_margin, 3),
        chosen=decision.chosen,
        reason=decision.reason,
        same_take=None if same is None else names[same.other],
        same_take_speed=None if same is None else round(same.rate, 3),
    )


def listed_shot(
    number: int,
    shot: Shot,
    people: int,
    occurrences: Sequence[ListedOccurrence],
    best: float | None,
    fps: float,
) -> ListedShot:
    """One shot; best: the score of what in it is most like the action, None where nobody moves."""
    frames = (shot.first, shot.stop)
    return ListedShot(
        number=number + 1,
        frames=frames,
        seconds=seconds(frames, fps),
        begins=shot.begins,
        ends=shot.ends,
        people=people,
        outcome=_outcome(shot, people, occurrences, best, fps),
    )


def _outcome(
    shot: Shot, people: int, occurrences: Sequence[ListedOccurrence], best: float | None, fps: float
) -> str:
    if occurrences:
        return "; ".join(f"{o.id}: {'a video' if o.chosen else o.reason}" for o in occurrences)
    if shot.still:
        return "still picture"
    if people == 0:
        return "nobody"
    if shot.stop - shot.first < LEAST_S * fps:
        return "too short"
    return f"nothing like the action (best score {max(best or 0.0, 0.0):.2f})"


HEAD = """\
# Collected by imocap: every video is an occurrence of the action in a longer film. collected.json
# lists all shots and occurrences, and why some are not here. More fields: see docs/actions.md.
"""


def write_action(folder: Path, collected: CollectedList, alone: dict[str, bool]) -> Path:
    """Write folder/action.yaml; its path.

    alone: of each chosen occurrence, whether its shot shows nobody else.
    """
    parts = [HEAD, f"name: {collected.name}\n", "videos:\n"]
    for occurrence in collected.chosen:
        parts += [f"  # {_comment(collected, occurrence)}\n"]
        entry = _entry(collected, occurrence, alone=alone[occurrence.id])
        text = yaml.safe_dump([entry], sort_keys=False, default_flow_style=None, width=1000)
        parts += [f"  {line}\n" for line in text.splitlines()]
    file = folder / ACTION_FILE
    write_whole(file, "".join(parts))
    return file


def clock(time_s: float) -> str:
    """Minutes and seconds, with hours where there are any: 1:02.4, 1:00:02.4."""
    minutes, rest = divmod(round(time_s, 1), 60)
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours}:{minutes:02d}:{rest:04.1f}" if hours else f"{minutes}:{rest:04.1f}"


def _comment(collected: CollectedList, o: ListedOccurrence) -> str:
    film = Path(collected.films[o.film].video).name
    speed = "" if 0.8 < o.speed < 1.25 else f", about {o.speed:.2g} times the speed"
    first, last = map(clock, o.seconds)
    name = "".join(c if c.isprintable() else "?" for c in film)  # nothing that ends a comment
    where = f"{name}, shot {o.shot}, {first} to {last}"
    return f"{where}: {o.view}, {o.height_px:.0f} px{speed}"


def _entry(collected: CollectedList, o: ListedOccurrence, *, alone: bool) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "id": o.id,
        "video": collected.films[o.film].video,
        "keypoints": DETECT,
        "frames": list(o.frames),
    }
    if o.mirrored:
        entry["mirrored"] = True
    if not alone:
        entry["person"] = {"frame": o.box_frame, "box": [round(x) for x in o.box_px]}
    return entry
