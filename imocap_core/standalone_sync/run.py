"""Synchronisation alone, from keypoints (and videos) to a table, a picture and a film."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, Sync
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.export.tables import write_sync_table
from imocap_core.figures.sync_summary import SyncRow, sync_rows
from imocap_core.pipeline import runner
from imocap_core.pipeline.action import FILE_NAME
from imocap_core.pipeline.builtin_actions import BUILT_IN
from imocap_core.pipeline.runner import Display, Job
from imocap_core.pipeline.stage import Context
from imocap_core.result.artifacts import Artifacts, artifacts_of_stages
from imocap_core.result.synchronisation import Synchronisation, synchronisation_of
from imocap_core.standalone_sync.action import write_sources
from imocap_core.standalone_sync.repetitions import cut, job_in_parts
from imocap_core.standalone_sync.sources import Declared, VideoSource, sources_of
from imocap_core.workspace import Workspace

STAGE = "sync"
CSV, PICTURE, FILM = "sync.csv", "sync.png", "side_by_side.mp4"


@dataclass(frozen=True)
class Synchronised:
    """The synchronisation of some videos, and the files in which it was written.

    action: a name or folder by which other commands find it. rows: one per video, its share
    matched, rate, confidence and offset. notes: sentences for the user.
    """

    action: str
    sync: Synchronisation
    rows: list[SyncRow]
    files: list[Path]
    notes: list[str]


@dataclass(frozen=True)
class SolvedSync:
    """The synchronisation of the videos of an action, before anything is written beside it."""

    job: Job
    action: str
    keypoints: Keypoints
    sync: Sync
    notes: list[str]

    @property
    def values(self) -> Synchronisation:
        """The correspondences as arrays."""
        videos = self.keypoints.videos
        return synchronisation_of(
            self.sync, {v.id: v.source_frames for v in videos}, {v.id: v.fps for v in videos}
        )


def synchronise_action(
    workspace: Workspace,
    words: Sequence[str | VideoSource],
    declared: Declared,
    *,
    name: str | None,
    reference: str | None,
    repetitions: bool,
    sets: list[str],
    display: Display,
) -> SolvedSync:
    """Run an action's stages up to sync. WorkFailed, WrongUse.

    Args:
        words: an action, or videos and keypoints, each as `sources_of` reads it.
        declared: what is known of all sources where their files do not say it.
        name: of the results below artifacts/.
        reference: id of the video whose time axis is used; else a central one.
        repetitions: cut one long clip into its repetitions first.
    """
    action = _action_of(workspace, words, declared, name)
    if repetitions:
        job, notes = _cut(workspace, action, name, sets, display)
    else:
        job, notes = job_in_parts(workspace, action, sets, display)
    action = str(job.action.folder) if notes else action
    if len(job.action.videos) < 2:
        raise WrongUse(
            f"{action} is one video: give two or more, or cut a long clip with --repetitions"
        )
    ids = [v.id for v in job.action.videos]
    if reference is not None and reference not in ids:
        raise WrongUse(f"--reference {reference}: there is no such video; got {', '.join(ids)}")
    outcomes = runner.run(job, display, job.pipeline.upstream(STAGE))
    artifacts = artifacts_of_stages(job.action.name, {o.stage: o.stored for o in outcomes})
    keypoints, sync = artifacts.get(Keypoints), artifacts.get(Sync)
    if reference is not None and sync.reference != reference:
        if reference in sync.excluded:
            raise WorkFailed(
                f"--reference {reference}: {'; '.join(sync.notes)}; choose another video, or keep "
                f"it with --set sync.outliers=ignore"
            )
        sync = _about(reference, job, artifacts, sync, display)
    return SolvedSync(job, action, keypoints, sync, notes)


def write_synchronised(solved: SolvedSync, out: Path | None, display: Display) -> Synchronised:
    """Write sync.csv, a picture and, where there are videos, a film of them side by side.

    out: the folder; else artifacts/ACTION/sync.
    """
    job = solved.job
    folder = out or job.store.folder / job.action.name / STAGE
    try:
        files = _write(folder, solved, display)
    except OSError as error:
        raise WorkFailed(f"cannot write to {folder}: {error.strerror}") from None
    rows = sync_rows(solved.keypoints, solved.sync)
    return Synchronised(solved.action, solved.values, rows, files, solved.notes)


def _action_of(
    workspace: Workspace, words: Sequence[str | VideoSource], declared: Declared, name: str | None
) -> str:
    """The one action named, or one made of the videos and keypoints named."""
    actions = [w for w in words if isinstance(w, str) and _is_action(workspace, w)]
    if actions and (len(words) > 1 or name is not None):
        raise WrongUse(f"{actions[0]} is an action: give it alone, without --name")
    if actions:
        return actions[0]
    return str(write_sources(workspace.root, name, sources_of(words), declared))


def _is_action(workspace: Workspace, word: str) -> bool:
    places = (workspace.root / "actions" / word / FILE_NAME, Path(word) / FILE_NAME)
    return word in BUILT_IN or Path(word).name == FILE_NAME or any(p.is_file() for p in places)


def _cut(
    workspace: Workspace, action: str, name: str | None, sets: list[str], display: Display
) -> tuple[Job, list[str]]:
    """The job of an action whose videos are the repetitions in the one video of another."""
    job = workspace.ready_job(action, sets, display)
    if len(job.action.videos) != 1:
        raise WrongUse(f"--repetitions: expected one long clip, got {len(job.action.videos)}")
    only = [job.action.videos[0].id]
    folder, notes = cut(workspace, job, only, f"{name or job.action.name}-repetitions", display)
    return workspace.ready_job(str(folder), sets, display), notes


def _about(
    reference: str,
    job: Job,
    artifacts: Artifacts,
    former: Sync,
    display: Display,
) -> Sync:
    """The synchronisation with another reference than the one that is chosen."""
    from imocap_core.problem.first_sync import synchronise_monocular
    from imocap_core.problem.hints import hints_of
    from imocap_core.problem.mirroring import known_mirrors
    from imocap_core.problem.sound import with_sound

    keypoints = artifacts.get(Keypoints)
    display.progress(0.5, f"again, with the reference {reference}")
    reads = frozenset(job.pipeline.stages[STAGE].reads)
    ctx = Context(STAGE, job.settings.seed, reads, display.progress, Path(), job.action)
    try:
        hints = hints_of(*ctx.hints(), keypoints, str(ctx.action_file()))
        if former.sound_start_s is not None:
            hints = with_sound(hints, former.sound_start_s, keypoints)
        return synchronise_monocular(
            artifacts.get(InitialSmpl),
            keypoints,
            job.settings.params.sync,
            ctx.rng(),
            reference=reference,
            mirrored=known_mirrors(ctx.mirrored(), keypoints),
            hints=hints,
            cameras=artifacts.get(CameraMotion),
        )
    except ValueError as error:
        raise WorkFailed(f"{STAGE}: {error}") from None


def _write(folder: Path, solved: SolvedSync, display: Display) -> list[Path]:
    from imocap_core.figures.style import quiet, save
    from imocap_core.figures.sync_picture import sync_picture
    from imocap_core.film.phase_bar import lock_step
    from imocap_core.io.video import write_h264

    job, keypoints, sync = solved.job, solved.keypoints, solved.sync
    folder.mkdir(parents=True, exist_ok=True)
    written = [write_sync_table(folder, solved.values)]
    with quiet():
        reach_s = job.settings.params.sync.confidence_reach_s
        save(sync_picture(keypoints, sync, reach_s=reach_s), folder / PICTURE)
    written.append(folder / PICTURE)
    files = {v.id: job.action.folder / v.video for v in job.action.videos if v.video is not None}
    if len(files) > 1:
        display.progress(0.0, "writing the film")
        fps = next(v.fps for v in keypoints.videos if v.id == sync.reference)
        film = lock_step(keypoints, sync, files, job.action.name)
        try:
            write_h264(folder / FILM, film, fps, faststart=True)
        except ValueError as error:
            raise WorkFailed(str(error)) from None
        written.append(folder / FILM)
    return written
