"""Synchronisation alone: of videos and keypoints on disk, or of arrays."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from imocap_core.errors import WrongUse
from imocap_core.library.api_errors import Params, Progress, displaying, one_off, plain_errors
from imocap_core.library.outputs import output_folder
from imocap_core.pipeline.format_names import DetectionFormat, Layout
from imocap_core.result.video import Synchronisation, synchronisation_of
from imocap_core.sync_sources import Declared, VideoSource, read_size, sources_of
from imocap_core.workspace import Workspace

if TYPE_CHECKING:
    from imocap_core.standalone_sync import Synchronised

Clip = str | Path | np.ndarray


@plain_errors
def synchronise(
    clips: Sequence[Clip],
    *,
    fps: float | None = None,
    layout: Layout | None = None,
    size: tuple[int, int] | None = None,
    reference: str | None = None,
    params: Params = None,
    root: str | Path | None = None,
    progress: Progress = None,
) -> Synchronisation:
    """Find which frames of several clips of one action show the same moment.

    Args:
        clips: two or more; either all arrays (T, 24, 3) of SMPL's joints in 3D (any axes, any unit,
            NaN where missing), or 2D detections, from which 3D poses are estimated first: arrays
            (T, K, 3) of x, y in pixels and confidence (or (T, K, 2)), with `layout`; or paths of
            keypoint folders or files, of videos with keypoints beside them, or VIDEO:KEYPOINTS.
        fps: frames per second; of a video it is read from the file.
        layout: the K keypoints of 2D arrays (body25, coco17, ...), or of files that do not say it.
        size: width and height of the pictures in pixels, for 2D keypoints without a video.
        reference: id of the clip whose time axis is used; else a central one. Arrays are
            called v1, v2, ...; files by their names.
        params: one-off parameters, as {"sync.max_rate": 8}.
        root: for files, a working folder in whose artifacts/ the estimated poses are stored for
            the next call (and in which people are detected); else nothing is stored.
        progress: as of `run`.

    Raises:
        WrongUse: shapes that do not fit, or a missing fps, size or layout.
        WorkFailed: files that cannot be read.
    """
    if len(clips) < 2:
        raise WrongUse(f"clips: expected two or more, got {len(clips)}")
    arrays = [clip for clip in clips if isinstance(clip, np.ndarray)]
    if layout is None and len(arrays) == len(clips):
        return _of_joints(arrays, fps, reference, params)
    if arrays and (layout is None or fps is None or size is None):
        raise WrongUse("clips: 2D keypoints as arrays need layout, fps and size=(width, height)")
    from imocap_core.standalone_sync import synchronise_action

    with tempfile.TemporaryDirectory(prefix="imocap-") as temporary:
        sources = sources_of(
            [
                _keypoint_file(Path(temporary), f"v{number}", clip)
                if isinstance(clip, np.ndarray)
                else str(clip)
                for number, clip in enumerate(clips, start=1)
            ]
        )
        without = [source.stem for source in sources if source.keypoints is None]
        if without and root is None:
            raise WrongUse(
                f"{', '.join(without)}: no keypoints beside the video; give root=..., the working "
                f"folder in which people are detected"
            )
        folder = Path(temporary) if arrays or root is None else Path(root)
        declared = Declared(None, layout, fps, size)
        with displaying(progress) as display:
            solved = synchronise_action(
                Workspace(folder),
                sources,
                declared,
                name=None,
                reference=reference,
                repetitions=False,
                sets=one_off(params),
                display=display,
            )
        return solved.values


@plain_errors
def synchronise_videos(
    words: Sequence[str],
    *,
    format: DetectionFormat | None = None,
    layout: Layout | None = None,
    fps: float | None = None,
    size: str | None = None,
    name: str | None = None,
    out: str | Path | None = None,
    reference: str | None = None,
    repetitions: bool = False,
    root: str | Path = ".",
    params: Params = None,
    progress: Progress = None,
) -> Synchronised:
    """Synchronise videos, keypoints or an action, and write sync.csv, a picture and a film.

    Args:
        words: keypoint folders or files, videos with keypoints beside them, VIDEO:KEYPOINTS, or
            one action.
        size: of the pictures, as in 1920x1080, for keypoints without a video.
        name: of the results below artifacts/. out: another folder for the files.
        repetitions: cut one long clip into its repetitions first.
    """
    from imocap_core.standalone_sync import synchronise_action, write_synchronised

    folder = None if out is None else output_folder(out)
    with displaying(progress) as display:
        solved = synchronise_action(
            Workspace(Path(root)),
            words,
            Declared(format, layout, fps, read_size(size)),
            name=name,
            reference=reference,
            repetitions=repetitions,
            sets=one_off(params),
            display=display,
        )
        return write_synchronised(solved, folder, display)


def _keypoint_file(folder: Path, label: str, clip: np.ndarray) -> VideoSource:
    """A 2D clip, written to the npz file that the program reads."""
    if clip.ndim != 3 or clip.shape[-1] not in (2, 3):
        raise WrongUse(f"clips: expected 2D keypoints (T, K, 2 or 3), got {clip.shape}")
    points = np.asarray(clip, dtype=np.float64)
    if points.shape[-1] == 2:
        visible = np.isfinite(points).all(axis=-1, keepdims=True).astype(np.float64)
        points = np.concatenate([points, visible], axis=-1)
    file = folder / f"{label}.npz"
    np.savez(file, keypoints=points)
    return VideoSource(None, file, label)


def _of_joints(
    arrays: Sequence[np.ndarray], fps: float | None, reference: str | None, params: Params
) -> Synchronisation:
    """The synchronisation of 3D joints (T, 24, 3), by the defaults of pipeline.yaml."""
    from imocap_core.adapters.synchronisation import synchronise_joints
    from imocap_core.pipeline.graph import settings

    wrong = [a.shape for a in arrays if a.ndim != 3 or a.shape[1:] != (24, 3)]
    if wrong:
        raise WrongUse(
            f"clips: expected SMPL's joints (T, 24, 3), or 2D keypoints with layout=...; "
            f"got {wrong[0]}"
        )
    if fps is None:
        raise WrongUse("fps: expected the frames per second of the arrays")
    pipeline = Workspace(Path()).pipeline()
    chosen = settings(pipeline, {}, pipeline.file, one_off(params))
    ids = [f"v{number}" for number in range(1, len(arrays) + 1)]
    if reference is not None and reference not in ids:
        raise WrongUse(f"reference {reference!r}: there is no such clip; got {', '.join(ids)}")
    summary = synchronise_joints(
        [np.asarray(a, dtype=np.float64) for a in arrays],
        ids,
        [fps] * len(arrays),
        chosen.params.sync,
        np.random.default_rng([chosen.seed, *b"sync"]),
        reference=reference,
    )
    frames = {name: np.arange(len(a)) for name, a in zip(ids, arrays, strict=True)}
    return synchronisation_of(summary, frames, dict.fromkeys(ids, fps))
