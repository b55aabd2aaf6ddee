"""The films of an action, from its artifacts and videos: what each shows, and writing it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

from imocap_core.artifacts.codec import ArtifactCorrupt
from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, RefineSync
from imocap_core.artifacts.schemas.base import Artifact
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.runner import Job

Kind = Literal["overlay", "side-by-side", "both"]
Result = Literal["final", "monocular"]
Made = TypeVar("Made", bound=Artifact)

SIDE_BY_SIDE = "side_by_side.mp4"


@dataclass(frozen=True)
class Film:
    """A film to be written: its file's name, its length, and its frames (RGB) one by one."""

    name: str
    count: int
    fps: float
    frames: Callable[[], Iterator[Any]]


def films_of(job: Job, kind: Kind, *, mesh: bool, result: Result, opacity: float) -> list[Film]:
    """The films of an action. WorkFailed when it has not been run."""
    from imocap_core.body import load_free_body
    from imocap_core.figures.sync_summary import common_moments
    from imocap_core.film.overlay_film import overlay_film
    from imocap_core.film.performer import Painter, performers
    from imocap_core.film.phase_bar import lock_step

    keypoints = stored(job, "keypoints", Keypoints)
    camera_motion = stored(job, "camera_motion", CameraMotion)
    refined = stored(job, "refine_sync", RefineSync)
    model = load_free_body()
    if result == "final":
        motions, cameras = refined.motion.videos, refined.motion.cameras
    else:
        motions, cameras = stored(job, "initial_smpl", InitialSmpl).videos, None
    files = video_files(job)
    cast = performers(keypoints, camera_motion, motions, cameras, files, model)

    def overlay(number: int) -> Callable[[], Iterator[Any]]:
        return lambda: overlay_film(cast[number], model, alpha=opacity)

    films = []
    if kind != "side-by-side":
        films += [
            Film(f"overlay_{p.seen.id}.mp4", len(p.seen.frames), p.seen.fps, overlay(n))
            for n, p in enumerate(cast)
        ]
    if kind != "overlay" and len(cast) > 1:
        sync = refined.sync
        fps = next(v.fps for v in keypoints.videos if v.id == sync.reference)
        count = len(common_moments(keypoints, sync))
        paints = {
            p.seen.id: Painter(p, model, alpha=opacity if mesh else 0.0)
            for p in cast
            if mesh or p.file is None  # where there is no video, keypoints are shown
        }

        def together() -> Iterator[Any]:
            return lock_step(keypoints, sync, files, job.action.name, paints)

        films.append(Film(SIDE_BY_SIDE, count, fps, together))
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


def video_files(job: Job) -> dict[str, Path | None]:
    """Each video's file; None where action.yaml names none, or it is gone."""
    folder = job.action.folder
    named = {v.id: folder / v.video for v in job.action.videos if v.video is not None}
    there = {i: file for i, file in named.items() if file.is_file()}
    return {v.id: there.get(v.id) for v in job.action.videos}


def stored(job: Job, stage: str, kind: type[Made]) -> Made:
    """A stage's current artifact. WorkFailed says how to make it when there is none."""
    name, folder = job.action.name, job.action.folder
    again = f"make it with: imocap run {name if folder.parent.name == 'actions' else folder}"
    try:
        found = job.store.load(name, stage)
        if found is None:
            raise WorkFailed(f"{name} has no {stage} artifact yet; {again}")
        return found.decode(kind)
    except ArtifactCorrupt as error:
        raise WorkFailed(f"{stage} of {name} {str(error).splitlines()[0]}; {again}") from None
