"""keypoints: the performer's 2D joints in every used frame of every video."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from imocap_core.artifacts.schemas import HandKeypoints, Keypoints, VideoKeypoints
from imocap_core.body.layouts import body_layout, hand_columns, layout_names
from imocap_core.camera.tracking import Performer, choose_performer
from imocap_core.formats.detectors import format_and_layout, read_detections
from imocap_core.formats.openpose import Detections
from imocap_core.formats.openpose_hands import read_openpose_hands
from imocap_core.formats.video import VideoInfo, probe
from stages.harness.action import Declaration
from stages.harness.stage import Context, Inputs, main
from stages.params import KeypointsParams, Params


def run(ctx: Context, inputs: Inputs, params: Params) -> Keypoints:
    """Read the detections, follow everybody, keep the performer."""
    declarations = ctx.declarations()
    _all_have_keypoints(declarations, ctx)
    videos = []
    for number, declared in enumerate(declarations):
        ctx.progress(number / len(declarations), f"following people in {declared.id}")
        videos.append(_performer_of(declared, ctx, params.keypoints))
    return Keypoints(videos=videos)


def _all_have_keypoints(declarations: tuple[Declaration, ...], ctx: Context) -> None:
    """One sentence for everything that is missing."""
    without = [v.id for v in declarations if ctx.detections(v.id) is None]
    if without:
        raise ValueError(
            f"{ctx.action_file()}: no 2D keypoints for {', '.join(without)}: run a detector such "
            "as OpenPose on the video and name its folder of JSON files in `keypoints`, with "
            "`format: openpose` and its `layout` (docs/formats.md lists what else is read)"
        )


def _performer_of(declared: Declaration, ctx: Context, params: KeypointsParams) -> VideoKeypoints:
    folder, video = ctx.detections(declared.id), ctx.video(declared.id)
    assert folder is not None
    probed = None if video is None else probe(video)
    kind, layout = format_and_layout(folder, declared.format, declared.layout)
    size = declared.size if probed is None else probed.size
    assert size is not None
    names = (declared.id, *((video.name, video.stem) if video is not None else ()))
    found = read_detections(folder, kind, layout, size=size, names=names)
    info = probed or _declared_info(declared, found)
    frames = _used_frames(declared, info.frame_count, ctx.action_file())
    people_of = dict(zip(found.frames.tolist(), found.people, strict=True))
    nobody = np.zeros((0, *found.people[0].shape[1:]))
    performer = choose_performer(
        [people_of.get(int(frame), nobody) for frame in frames],
        info.size,
        info.fps,
        min_confidence=params.min_confidence,
        max_gap_s=params.max_gap_s,
    )
    if performer.tracks_found == 0:
        raise ValueError(
            f"{folder}: expected a person in frames {frames[0]} to {frames[-1]}, found nobody with "
            f"joints above confidence {params.min_confidence}; check the detections of "
            f"{declared.id} and its `frames` in action.yaml"
        )
    _must_fit_picture(performer.xy_px, info.size, folder)
    body = slice(len(layout_names(body_layout(layout))))  # faces and hands are no part of it
    return VideoKeypoints(
        id=declared.id,
        fps=info.fps,
        size=info.size,
        layout=body_layout(layout),
        video=declared.video,
        focal_px=declared.focal_px,
        initial=declared.initial,
        initial_format=declared.initial_format,
        frames=frames,
        xy_px=performer.xy_px[:, body],
        confidence=performer.confidence[:, body],
        person_box_px=performer.box_px,
        tracks_found=performer.tracks_found,
        presence=performer.presence,
        note=performer.note,
        hands=_hands_of(kind, layout, folder, frames, performer),
    )


def _hands_of(
    kind: str, layout: str, folder: Path, frames: np.ndarray, performer: Performer
) -> HandKeypoints | None:
    """The performer's hands, where the detector found any."""
    columns = hand_columns(layout)
    if columns is not None:
        seen = performer.confidence[:, columns]
        if not (seen > 0).any():
            return None
        return HandKeypoints(xy_px=performer.xy_px[:, columns], confidence=seen)
    if kind != "openpose":
        return None
    found = read_openpose_hands(folder, frames, performer.xy_px)
    return None if found is None else HandKeypoints(xy_px=found[0], confidence=found[1])


def _must_fit_picture(xy_px: np.ndarray, size: tuple[int, int], folder: Path) -> None:
    """Detectors put points a little outside at most; pixels of another size end up far outside."""
    seen = xy_px[np.isfinite(xy_px).all(axis=-1)] / np.array(size)
    if ((seen < -0.1) | (seen > 1.1)).any(axis=-1).mean() > 0.3:
        x, y = (seen.max(axis=0) * size).round().astype(int)
        raise ValueError(
            f"{folder}: expected pixels of a picture of {size[0]} x {size[1]}, got points out "
            f"to ({x}, {y}); run the detector on this very video, or correct `size` in action.yaml"
        )


def _declared_info(declared: Declaration, found: Detections) -> VideoInfo:
    """As action.yaml declares a video that is not there."""
    assert declared.fps is not None
    assert declared.size is not None
    return VideoInfo(declared.fps, declared.size, int(found.frames[-1]) + 1)


def _used_frames(declared: Declaration, count: int, file: Path) -> np.ndarray:
    """Source frame numbers (T,)."""
    first, stop = declared.frames or (0, count)
    if stop > count:
        raise ValueError(
            f"{file}: videos.{declared.id}.frames: expected at most [0, {count}], as the clip has "
            f"{count} frames, got [{first}, {stop}]"
        )
    return np.arange(first, stop, dtype=np.int64)


if __name__ == "__main__":
    raise SystemExit(main("keypoints"))
