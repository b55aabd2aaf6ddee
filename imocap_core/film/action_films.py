"""The films of a result: what each shows, and writing it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, RefineSync
from imocap_core.errors import WorkFailed
from imocap_core.problem.lenses import lenses_of
from imocap_core.problem.relative_motion import paths_of, paths_of_initial, relative_motions
from imocap_core.result.read import read_monocular
from imocap_core.result.result import ActionResult

FilmKind = Literal["overlay", "side-by-side", "both"]
MotionKind = Literal["final", "monocular"]

SIDE_BY_SIDE = "side_by_side.mp4"


@dataclass(frozen=True)
class Film:
    """A film to be written: its file's name, its length, and its frames (RGB) one by one."""

    name: str
    count: int
    fps: float
    frames: Callable[[], Iterator[Any]]


def films_of(
    result: ActionResult, kind: FilmKind, *, mesh: bool, motion: MotionKind, opacity: float
) -> list[Film]:
    """The films of an action: the body over each video, and all videos in lock-step.

    Args:
        mesh: draw the body in the side-by-side film too.
        motion: the final one, or what each video alone says.
        opacity: of the body, 0 to 1.
    """
    from imocap_core.body import load_free_body
    from imocap_core.figures.sync_summary import common_moments
    from imocap_core.film.overlay_body import Painter, overlay_bodies
    from imocap_core.film.overlay_film import overlay_film
    from imocap_core.film.phase_bar import lock_step

    artifacts = result.artifacts
    keypoints, sync = artifacts.get(Keypoints), result.sync.summary
    model = load_free_body()
    if motion == "final":
        solved = artifacts.get(RefineSync).motion
        motions, cameras = solved.videos, solved.cameras
        paths = paths_of(solved.cameras)
    else:
        motions, cameras = read_monocular(artifacts), None
        paths = paths_of_initial(artifacts.get(InitialSmpl), artifacts.get(CameraMotion))
    motions = relative_motions(motions, paths)
    files = {video.id: video.video for video in result}
    camera_motion = artifacts.get(CameraMotion)
    lenses = lenses_of(camera_motion, artifacts.get(RefineSync) if motion == "final" else None)
    bodies = overlay_bodies(keypoints, camera_motion, motions, cameras, files, model, lenses)

    def overlay(number: int) -> Callable[[], Iterator[Any]]:
        return lambda: overlay_film(bodies[number], model, alpha=opacity)

    films = []
    if kind != "side-by-side":
        films += [
            Film(f"overlay_{v.id}.mp4", len(v.frames), v.fps, overlay(n))
            for n, v in enumerate(keypoints.videos)
        ]
    if kind != "overlay" and len(bodies) > 1:
        paints = {
            body.keypoints.id: Painter(body, model, alpha=opacity if mesh else 0.0)
            for body in bodies
            if mesh or body.file is None  # where there is no video, keypoints are shown
        }

        def together() -> Iterator[Any]:
            return lock_step(keypoints, sync, files, result.action, paints)

        fps = result[result.reference].fps
        films.append(Film(SIDE_BY_SIDE, len(common_moments(keypoints, sync)), fps, together))
    return films


def write_films(
    films: Sequence[Film], folder: Path, advance: Callable[[Film, int], None]
) -> list[Path]:
    """Write the films to a folder; `advance(film, frames done)` is called after each frame."""
    from imocap_core.io.prefetch import prefetch
    from imocap_core.io.video import write_h264

    def counted(film: Film) -> Iterator[Any]:
        for done, frame in enumerate(prefetch(film.frames()), start=1):
            yield frame
            advance(film, done)

    try:
        folder.mkdir(parents=True, exist_ok=True)
        for film in films:
            write_h264(folder / film.name, counted(film), film.fps, faststart=True)
    except OSError as error:
        raise WorkFailed(f"cannot write to {folder}: {error.strerror or error}") from None
    except ValueError as error:
        raise WorkFailed(str(error)) from None
    return [folder / film.name for film in films]
