"""keypoints: the performer's 2D joints in every used frame of every video."""

from __future__ import annotations

from dataclasses import replace

from imocap_core.artifacts.schemas import HandKeypoints, Keypoints, VideoKeypoints
from imocap_core.body.layouts import body_layout, hand_columns, layout_names
from imocap_core.cli import stage_main
from imocap_core.io.detectors.mediapipe_hands import read_mediapipe_hands
from imocap_core.io.detectors.openpose_hands import read_openpose_hands
from imocap_core.params import KeypointsParams, Params
from imocap_core.people.performer import PerformerKeypoints
from imocap_core.pipeline.action import Declaration
from imocap_core.pipeline.stage import Context, Inputs
from imocap_core.problem.cuts import advice, cuts_of
from imocap_core.problem.declarations import check_fits_picture
from imocap_core.problem.detected_people import DetectedVideo, read_people
from imocap_core.problem.tracked_people import choose_performers, track_people


def run(ctx: Context, inputs: Inputs, params: Params) -> Keypoints:
    """Read the detections, track everybody, choose the performer."""
    declarations = ctx.declarations()
    _check_all_have_keypoints(declarations, ctx)
    videos = []
    for number, declared in enumerate(declarations):
        ctx.progress(number / len(declarations), f"tracking people in {declared.id}")
        videos.append(_tracked(declared, ctx, params.keypoints))
    performers = choose_performers(
        [video.people for video in videos], ctx.action_file(), params.keypoints
    )
    return Keypoints(
        videos=[
            _keypoints_of(video, performer, params.keypoints)
            for video, performer in zip(videos, performers, strict=True)
        ]
    )


def _check_all_have_keypoints(declarations: tuple[Declaration, ...], ctx: Context) -> None:
    """ValueError naming every video without keypoints."""
    without = [v.id for v in declarations if ctx.detections(v.id) is None]
    if without:
        raise ValueError(
            f"{ctx.action_file()}: no 2D keypoints for {', '.join(without)}: write `keypoints: "
            "detect` to run a detector (docs/detection.md), or run one such as OpenPose yourself "
            "and name its folder of JSON files (docs/formats.md lists the other formats)"
        )


def _tracked(declared: Declaration, ctx: Context, params: KeypointsParams) -> DetectedVideo:
    folder, video = ctx.detections(declared.id), ctx.video(declared.id)
    assert folder is not None
    detected = read_people(declared, folder, video, ctx.action_file())
    people = track_people(detected.people, video, params)
    if not people.ranked:
        frames = people.frames
        raise ValueError(
            f"{folder}: expected a person in frames {frames[0]} to {frames[-1]}, found nobody with "
            f"joints above confidence {params.min_confidence}; check the detections of "
            f"{declared.id} and its `frames` in action.yaml"
        )
    return replace(detected, people=people)


def _keypoints_of(
    video: DetectedVideo, performer: PerformerKeypoints, params: KeypointsParams
) -> VideoKeypoints:
    declared, people = video.declared, video.people
    probed = video.video is not None
    check_fits_picture(performer.xy_px, people.size, video.folder, probed=probed)
    body = slice(len(layout_names(body_layout(people.layout))))  # without faces and hands
    return VideoKeypoints(
        id=declared.id,
        fps=people.fps,
        size=people.size,
        layout=body_layout(people.layout),
        video=declared.video,
        focal_px=declared.focal_px,
        initial=declared.initial,
        initial_format=declared.initial_format,
        frames=people.frames,
        xy_px=performer.xy_px[:, body],
        confidence=performer.confidence[:, body],
        person_box_px=performer.box_px,
        tracks_found=performer.tracks_found,
        presence=performer.presence,
        note=_note_of(video, performer, params),
        hands=_hands_of(video, performer),
    )


def _note_of(video: DetectedVideo, performer: PerformerKeypoints, params: KeypointsParams) -> str:
    """The note on a video's people, and advice about its cuts."""
    if video.video is None or not params.cuts:
        return performer.note
    frames = video.people.frames
    sentence = advice(cuts_of(video.video, frames, video.people.size), frames)
    return f"{performer.note}; {sentence}" if sentence else performer.note


def _hands_of(video: DetectedVideo, performer: PerformerKeypoints) -> HandKeypoints | None:
    """The performer's hands, where the detector found any."""
    columns = hand_columns(video.people.layout)
    if columns is not None:
        confidence = performer.confidence[:, columns]
        if not (confidence > 0).any():
            return None
        return HandKeypoints(xy_px=performer.xy_px[:, columns], confidence=confidence)
    frames = video.people.frames
    if video.kind == "mediapipe":
        hands = read_mediapipe_hands(video.folder, frames, video.people.size)
    elif video.kind == "openpose":
        hands = read_openpose_hands(video.folder, frames, performer.xy_px)
    else:
        return None
    return None if hands is None else HandKeypoints(xy_px=hands[0], confidence=hands[1])


if __name__ == "__main__":
    raise SystemExit(stage_main("keypoints"))
