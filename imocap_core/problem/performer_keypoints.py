"""The performer of a video, as the stage keypoints gives them on."""

from __future__ import annotations

import numpy as np

from imocap_core.artifacts.schemas import CorrectedMarks, HandKeypoints, VideoKeypoints
from imocap_core.body.layouts import body_layout, hand_columns, layout_names
from imocap_core.io.detectors.mediapipe_hands import read_mediapipe_hands
from imocap_core.io.detectors.openpose_hands import read_openpose_hands
from imocap_core.marks.correction import corrected_marks
from imocap_core.marks.weights import load_correction
from imocap_core.params import KeypointsParams
from imocap_core.people.performer import PerformerKeypoints, without_frames
from imocap_core.problem.cuts import advice
from imocap_core.problem.declarations import check_fits_picture
from imocap_core.problem.detected_people import DetectedVideo
from imocap_core.problem.estimates import detected_joints
from imocap_core.problem.even_moments import at_even_moments


def performer_keypoints(
    video: DetectedVideo, performer: PerformerKeypoints, params: KeypointsParams
) -> VideoKeypoints:
    """A video's entry of the artifact, at a constant rate. ValueError when the performer is not in
    its picture."""
    declared, people = video.declared, video.people
    probed = video.video is not None
    check_fits_picture(performer.xy_px, people.size, video.folder, probed=probed)
    survey = video.survey
    if survey is not None:
        performer = without_frames(performer, survey.damaged)
    body = slice(len(layout_names(body_layout(people.layout))))  # without faces and hands
    of_frames = VideoKeypoints(
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
        damaged=None if survey is None else survey.damaged_spans(people.frames),
        performer=declared.performer,
        distortion=declared.distortion,
        mirrored=video.mirrored or None,
    )
    even = at_even_moments(of_frames, video.time_s)
    if video.kind == "mediapipe":
        even = even.model_copy(update={"joints_m": detected_joints(video.folder, even)})
    return with_corrected_marks(even) if params.correct_marks else even


def with_corrected_marks(video: VideoKeypoints) -> VideoKeypoints:
    """The keypoints with the correction of their layout's marks, where it has one."""
    correction = load_correction(video.layout)
    if correction is None:
        return video
    xy_px = corrected_marks(video.xy_px, layout_names(video.layout), correction)
    return video.model_copy(update={"corrected": CorrectedMarks(xy_px=xy_px)})


def _note_of(video: DetectedVideo, performer: PerformerKeypoints, params: KeypointsParams) -> str:
    """The note on a video's people, on how its file was read, and advice about its cuts."""
    parts = [performer.note, *video.remarks]
    if video.survey is not None and params.cuts:
        parts.append(advice(video.survey.cuts, video.people.frames))
    return "; ".join(part for part in parts if part)


def _hands_of(video: DetectedVideo, performer: PerformerKeypoints) -> HandKeypoints | None:
    """The performer's hands, where the detector found any."""
    columns = hand_columns(video.people.layout)
    if columns is not None:
        confidence = performer.confidence[:, columns]
        if not (confidence > 0).any():
            return None
        return HandKeypoints(xy_px=performer.xy_px[:, columns], confidence=confidence)
    reading, frames = video.reading, video.people.frames
    numbers = np.rint(reading.number(frames)).astype(np.int64)
    if video.kind == "mediapipe":
        hands = read_mediapipe_hands(video.folder, numbers, video.people.size)
    elif video.kind == "openpose":
        hands = read_openpose_hands(video.folder, numbers, reading.in_file(performer.xy_px))
    else:
        return None
    if hands is None:
        return None
    sides = slice(None, None, -1 if reading.mirrored else 1)
    hands = reading.places(hands[0])[:, sides], hands[1][:, sides]
    out = np.zeros(len(frames), bool) if video.survey is None else video.survey.damaged
    xy_px = np.where(out[:, None, None, None], np.nan, hands[0])
    return HandKeypoints(xy_px=xy_px, confidence=np.where(out[:, None, None], 0.0, hands[1]))
