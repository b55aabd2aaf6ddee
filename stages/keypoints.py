"""keypoints: the performer's 2D joints in every used frame of every video."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from imocap_core.artifacts.schemas import HandKeypoints, Keypoints, VideoKeypoints
from imocap_core.body.layouts import body_layout, hand_columns, layout_names
from imocap_core.cli import stage_main
from imocap_core.io.detectors.mediapipe_hands import read_mediapipe_hands
from imocap_core.io.detectors.openpose_hands import read_openpose_hands
from imocap_core.params import KeypointsParams, Params
from imocap_core.people.tracking import Performer
from imocap_core.pipeline.action import Declaration
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.problem.cuts import advice, cuts_of
from imocap_core.problem.people import Source, people_in
from imocap_core.problem.performers import followed, performers


def run(ctx: Context, inputs: Inputs, params: Params) -> Keypoints:
    """Read the detections, follow everybody, keep the performer."""
    declarations = ctx.declarations()
    _all_have_keypoints(declarations, ctx)
    sources = []
    for number, declared in enumerate(declarations):
        ctx.progress(number / len(declarations), f"following people in {declared.id}")
        sources.append(_followed(declared, ctx, params.keypoints))
    chosen = performers([s.watched for s in sources], ctx.action_file(), params.keypoints)
    return Keypoints(
        videos=[
            _keypoints_of(source, performer, params.keypoints)
            for source, performer in zip(sources, chosen, strict=True)
        ]
    )


def _all_have_keypoints(declarations: tuple[Declaration, ...], ctx: Context) -> None:
    """One sentence for everything that is missing."""
    without = [v.id for v in declarations if ctx.detections(v.id) is None]
    if without:
        raise ValueError(
            f"{ctx.action_file()}: no 2D keypoints for {', '.join(without)}: write `keypoints: "
            "detect` to have people found (docs/detection.md), or run a detector such as OpenPose "
            "and name its folder of JSON files (docs/formats.md lists what else is read)"
        )


def _followed(declared: Declaration, ctx: Context, params: KeypointsParams) -> Source:
    folder, video = ctx.detections(declared.id), ctx.video(declared.id)
    assert folder is not None
    source = people_in(declared, folder, video, ctx.action_file())
    watched = followed(source.watched, video, params)
    if not watched.ranked:
        frames = watched.frames
        raise ValueError(
            f"{folder}: expected a person in frames {frames[0]} to {frames[-1]}, found nobody with "
            f"joints above confidence {params.min_confidence}; check the detections of "
            f"{declared.id} and its `frames` in action.yaml"
        )
    return replace(source, watched=watched)


def _keypoints_of(source: Source, performer: Performer, params: KeypointsParams) -> VideoKeypoints:
    declared, folder, seen = source.declared, source.folder, source.watched
    frames, layout, info = seen.frames, seen.layout, seen
    kind = source.kind
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
        note=_noted(source, performer, params),
        hands=_hands_of(kind, layout, folder, frames, performer, info.size),
    )


def _noted(source: Source, performer: Performer, params: KeypointsParams) -> str:
    """What is to be known of a video's people and shots."""
    if source.video is None or not params.cuts:
        return performer.note
    frames = source.watched.frames
    said = advice(cuts_of(source.video, frames, source.watched.size), frames)
    return f"{performer.note}; {said}" if said else performer.note


def _hands_of(
    kind: str,
    layout: str,
    folder: Path,
    frames: np.ndarray,
    performer: Performer,
    size: tuple[int, int],
) -> HandKeypoints | None:
    """The performer's hands, where the detector found any."""
    columns = hand_columns(layout)
    if columns is not None:
        seen = performer.confidence[:, columns]
        if not (seen > 0).any():
            return None
        return HandKeypoints(xy_px=performer.xy_px[:, columns], confidence=seen)
    if kind == "mediapipe":
        found = read_mediapipe_hands(folder, frames, size)
    elif kind == "openpose":
        found = read_openpose_hands(folder, frames, performer.xy_px)
    else:
        return None
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


if __name__ == "__main__":
    raise SystemExit(stage_main("keypoints"))
