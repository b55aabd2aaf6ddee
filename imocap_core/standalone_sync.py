"""`imocap sync`: synchronisation alone, and long clips cut into repetitions."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import yaml

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, Sync
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.export.npz_files import write_sync
from imocap_core.figures.sync_summary import SyncRow, sync_rows
from imocap_core.files import write_whole
from imocap_core.io.readers.keypoint_readers import guess_detections
from imocap_core.pipeline import runner
from imocap_core.pipeline.action import (
    DETECT,
    FILE_NAME,
    Action,
    Declaration,
    check_name,
    declared_path,
)
from imocap_core.pipeline.runner import Display, Job
from imocap_core.pipeline.stage import Context
from imocap_core.result.artifacts import Artifacts, artifacts_of_stages
from imocap_core.result.video import Synchronisation, synchronisation_of
from imocap_core.sync_sources import Declared, VideoSource, labels, sources_of
from imocap_core.workspace import Workspace, is_action


def job_in_parts(
    workspace: Workspace, action: str, sets: list[str], display: Display
) -> tuple[Job, list[str]]:
    """The job of an action in which videos with ``repetitions: true`` are cut into repetitions.

    Also a sentence on each clip that was cut. WorkFailed where nothing repeats.
    """
    job = workspace.ready_job(action, sets, display)
    long_clips = [v.id for v in job.action.videos if v.repetitions]
    if not long_clips:
        return job, []
    folder, notes = cut(workspace, job, long_clips, f"{job.action.name}-repetitions", display)
    return workspace.ready_job(str(folder), sets, display), notes


def cut(
    workspace: Workspace, job: Job, long_clips: Sequence[str], name: str, display: Display
) -> tuple[Path, list[str]]:
    """The folder of an action whose videos are the repetitions of long clips (and the videos that
    are none), and a sentence on each clip."""
    from imocap_core.sync.repetition import find_picture_repetitions, find_repetitions

    hinted = [*job.action.anchors, *job.action.forbidden]
    if hinted:
        raise WorkFailed(
            f"{job.action.file}: anchors and forbidden spans refer to whole videos, and "
            f"{', '.join(long_clips)} is cut into its repetitions; remove them, or cut it yourself "
            "with frames"
        )
    outcomes = runner.run(job, display, job.pipeline.upstream("initial_smpl"))
    artifacts = artifacts_of_stages(job.action.name, {o.stage: o.stored for o in outcomes})
    keypoints, initial = artifacts.get(Keypoints), artifacts.get(InitialSmpl)
    cameras = artifacts.get(CameraMotion).videos
    spans: dict[str, list[tuple[int, int]]] = {}
    notes = []
    for video, camera, motion in zip(keypoints.videos, cameras, initial.videos, strict=True):
        if video.id not in long_clips:
            continue
        repetitions = max(
            find_repetitions(motion.joints, video.fps),
            find_picture_repetitions(camera.xy_first_px, video.confidence, video.fps),
            key=lambda cut: cut.score,
        )
        if len(repetitions.spans) < 2:
            raise WorkFailed(f"{video.id}: {repetitions.status}; nothing to cut")
        spans[video.id] = [
            (int(video.frames[a]), int(video.frames[b - 1]) + 1) for a, b in repetitions.spans
        ]
        notes.append(f"{video.id}: {repetitions.status}")
    return _write_instances(workspace.root, job.action, name, spans), notes


HEAD = "# Written by imocap, which writes it again; copy it to actions/ to change it.\n"


def _write_sources(
    root: Path, name: str | None, sources: Sequence[VideoSource], declared: Declared
) -> Path:
    """The folder of an action of these sources, made or brought up to date.

    WorkFailed when keypoints are not understood, WrongUse when fps and size are missing or the
    name is taken.
    """
    blind = [str(s.keypoints) for s in sources if s.video is None]
    if blind and (declared.fps is None or declared.size is None):
        raise WrongUse(
            f"{', '.join(blind)}: without a video, frame rate and picture size of "
            f"keypoints are unknown; give both, as in --fps 30 --size 1920x1080"
        )
    names = labels(sources)
    folder = _results_folder(root, name or default_name("sync-", names, sources))
    videos = [
        _declaration(label, source, declared, folder)
        for label, source in zip(names, sources, strict=True)
    ]
    return write(folder, videos)


def _write_instances(
    root: Path, action: Action, name: str, spans: Mapping[str, Sequence[tuple[int, int]]]
) -> Path:
    """The folder of an action in which some videos are replaced by parts (first, stop) of them."""
    folder = _results_folder(root, name)
    videos = []
    for video in action.videos:
        whole = video.model_copy(update={"repetitions": None})
        if video.id not in spans:
            videos.append(_moved(whole, action.folder, folder))
            continue
        for number, frames in enumerate(spans[video.id], start=1):
            part = whole.model_copy(update={"id": f"{video.id}_r{number}", "frames": frames})
            videos.append(_moved(part, action.folder, folder))
    return write(folder, videos, action.params)


def write(
    folder: Path, videos: Sequence[dict[str, Any]], params: dict[str, Any] | None = None
) -> Path:
    """folder/action.yaml with these videos; untouched when it is equal."""
    content: dict[str, Any] = {"name": folder.name, "videos": list(videos)}
    if params:
        content["params"] = params
    text = HEAD + yaml.safe_dump(content, sort_keys=False)
    file = folder / FILE_NAME
    if not (file.is_file() and file.read_text(encoding="utf-8") == text):
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(file, text)
    return folder


def _results_folder(root: Path, name: str) -> Path:
    """artifacts/NAME; WrongUse when the name is invalid or another action's results are there."""
    check_name(name)
    folder = root / "artifacts" / name
    file = folder / FILE_NAME
    ours = file.is_file() and file.read_text(encoding="utf-8").startswith(HEAD)
    taken = (root / "actions" / name).exists() or (folder.is_dir() and any(folder.iterdir()))
    if taken and not ours:
        raise WrongUse(f"there is another action {name}; choose another name with --name")
    return folder


def default_name(prefix: str, names: Sequence[str], sources: Sequence[VideoSource]) -> str:
    """The common beginning of the names, and a few letters that differ for other sources."""
    same = takewhile(lambda letters: len(set(letters)) == 1, zip(*names, strict=False))
    shared = "".join(letters[0] for letters in same)
    paths = [str(path.resolve()) for s in sources for path in (s.video, s.keypoints) if path]
    digest = hashlib.sha256("\n".join(paths).encode()).hexdigest()[:6]
    word = shared.rstrip("0123456789_.-") or "videos"
    return f"{prefix}{word}-{digest}"


def _declaration(
    label: str, source: VideoSource, declared: Declared, folder: Path
) -> dict[str, Any]:
    if source.keypoints is None:
        assert source.video is not None
        return {"id": label, "video": declared_path(source.video, folder), "keypoints": DETECT}
    try:
        if declared.format is not None and declared.layout is not None:
            kind, layout = str(declared.format), str(declared.layout)
        else:
            kind, layout = guess_detections(source.keypoints, layout=declared.layout)
    except ValueError as error:
        raise WorkFailed(str(error)) from None
    entry: dict[str, Any] = {"id": label}
    if source.video is not None:
        entry["video"] = declared_path(source.video, folder)
    entry |= {
        "keypoints": declared_path(source.keypoints, folder),
        "format": declared.format or kind,
    }
    entry["layout"] = layout
    if source.video is None and declared.fps is not None and declared.size is not None:
        entry |= {"fps": declared.fps, "size": list(declared.size)}
    return entry


def _moved(declaration: Declaration, old: Path, new: Path) -> dict[str, Any]:
    """A declaration whose paths are relative to another folder."""
    entry = declaration.model_dump(mode="json", exclude_none=True, by_alias=True)
    for field in ("video", "keypoints", "initial"):
        if entry.get(field, DETECT) != DETECT:
            entry[field] = declared_path(old / entry[field], new)
    return entry


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
    actions = [w for w in words if isinstance(w, str) and is_action(workspace.root, w)]
    if actions and (len(words) > 1 or name is not None):
        raise WrongUse(f"{actions[0]} is an action: give it alone, without --name")
    if actions:
        return actions[0]
    return str(_write_sources(workspace.root, name, sources_of(words), declared))


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


def _about(reference: str, job: Job, artifacts: Artifacts, former: Sync, display: Display) -> Sync:
    """The synchronisation with another reference than the one that is chosen."""
    from imocap_core.adapters.hints import hints_of, with_sound
    from imocap_core.adapters.participants import known_mirrors
    from imocap_core.adapters.synchronisation import synchronise_monocular

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
    from imocap_core.figures.sync_figures import sync_picture
    from imocap_core.io.video import write_h264
    from imocap_core.lock_step import lock_step

    job, keypoints, sync = solved.job, solved.keypoints, solved.sync
    folder.mkdir(parents=True, exist_ok=True)
    written = [write_sync(folder, solved.values)]
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
