"""collected.json: every shot and every occurrence, and what became of them; validated."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from imocap_core.collect.choice import LEAST_S, Decision
from imocap_core.collect.occurrences import Occurrence
from imocap_core.collect.shots import Shot
from imocap_core.identifiers import Id
from imocap_core.whole_files import write_whole

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
    shot: Shot,
    people: int,
    occurrences: Sequence[ListedOccurrence],
    best: float | None,
    fps: float,
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
