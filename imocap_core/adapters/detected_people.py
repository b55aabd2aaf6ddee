"""One video of an action: detections read, pictures looked through, its performer tracked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int, Int64

from imocap_core.adapters import keypoint_reading, tracked_people
from imocap_core.adapters.estimates import detected_joints
from imocap_core.adapters.even_moments import at_even_moments
from imocap_core.artifacts.schemas import CorrectedMarks, HandKeypoints, VideoKeypoints
from imocap_core.body.layouts import body_layout, hand_columns, layout_names
from imocap_core.io.frame_access import variable_times_s, why_not_detected
from imocap_core.io.readers.json_people import read_openpose_hands
from imocap_core.io.readers.keypoint_readers import format_and_layout, read_detections
from imocap_core.io.readers.mediapipe import read_mediapipe_hands
from imocap_core.io.readers.people import DetectedPeople
from imocap_core.io.video import VideoInfo, probe, read_checked_gray
from imocap_core.lifter.keypoint_offsets import corrected_marks, load_correction
from imocap_core.limits import LEAST_FRAMES, MAX_FRAMES
from imocap_core.params import KeypointsParams
from imocap_core.people.performer import PerformerKeypoints, without_frames
from imocap_core.people.shot_boundaries import find_cuts
from imocap_core.pipeline.action import Declaration
from imocap_core.sequences import is_constant_rate, runs, typical_step_s

COMPARED_PX = 160  # larger side of the pictures that are compared
NEAR_S = 0.5  # damaged frames that are closer together are one span: what follows one is smeared
MOST_DAMAGED = 0.25  # of the used frames


@dataclass(frozen=True)
class VideoSurvey:
    """cuts: source frames with which a new shot begins. damaged: of each used frame, whether the
    decoder met errors in it or shortly before and after."""

    cuts: list[int]
    damaged: Bool[np.ndarray, " T"]

    def damaged_spans(self, frames: Int[np.ndarray, " T"]) -> list[tuple[int, int]] | None:
        """First and last source frame of each damaged span; None without any."""
        spans = [(int(frames[a]), int(frames[b])) for a, b in runs(self.damaged)]
        return spans or None


def survey_video(
    video: Path, frames: Int[np.ndarray, " T"], size: tuple[int, int], fps: float
) -> VideoSurvey:
    """Look through the used frames of a video.

    ValueError when it cannot be decoded, ends before its last used frame, or more of it is damaged
    than can be left out.
    """
    first, last = int(frames[0]), int(frames[-1])
    scale = min(1.0, COMPARED_PX / max(size))
    whole: list[bool] = []

    def pictures() -> Iterator[np.ndarray]:
        for _, picture, is_whole in read_checked_gray(video, first, last + 1, scale=scale):
            whole.append(is_whole)
            yield picture

    cuts = find_cuts(pictures())
    if len(whole) != len(frames):
        raise ValueError(
            f"{video}: expected frames {first} to {last}, the video ends after {len(whole)} of "
            "them; change `frames` in action.yaml or re-encode the video"
        )
    damaged = np.zeros(len(frames), bool)
    for a, b in runs(~np.array(whole), gap=round(NEAR_S * fps)):
        damaged[a : b + 1] = True
    if damaged.mean() > MOST_DAMAGED:
        a, b = np.flatnonzero(damaged)[[0, -1]] + first
        raise ValueError(
            f"{video}: {damaged.mean():.0%} of its frames are damaged (between frames {a} and "
            f"{b}); get the video again, or use another part: `frames` in action.yaml"
        )
    near = damaged | np.r_[False, damaged[:-1]]
    return VideoSurvey([first + cut for cut in cuts if not near[cut]], damaged)


AS_THEY_ARE = keypoint_reading.Reading()
IN_SHARES = ("mediapipe",)  # formats whose points come in shares of the shown picture


@dataclass(frozen=True)
class DetectedVideo:
    """One video's declaration, files and people: `kind` is the format of the detections.

    survey: of the pictures, where there is a video and they have been looked through. time_s: when
    the used frames were taken, where the frame rate is variable. reading: of the keypoints' pixels
    and numbers. remarks: how the file and its keypoints were read, where it is not as usual.
    """

    declared: Declaration
    folder: Path
    video: Path | None
    kind: str
    people: tracked_people.TrackedVideo  # without tracks until `track_people`
    survey: VideoSurvey | None = None
    time_s: Float[np.ndarray, " T"] | None = None
    reading: keypoint_reading.Reading = AS_THEY_ARE
    remarks: tuple[str, ...] = ()
    mirrored: bool = False  # the file has its players show the mirror image

    @property
    def id(self) -> str:
        """The video's id."""
        return self.declared.id


def read_people(
    declared: Declaration, folder: Path, video: Path | None, file: Path
) -> DetectedVideo:
    """Read a video's detections in its used frames; `file`: the action.yaml, for messages."""
    probed = None if video is None else probe(video)
    keypoint_reading.check_declared(declared, probed, file)
    if probed is not None:
        probed = keypoint_reading.at_declared_rate(declared, probed)
    kind, layout = format_and_layout(folder, declared.format, declared.layout)
    size = declared.size if probed is None else probed.size
    assert size is not None
    names = (declared.id, *((video.name, video.stem) if video is not None else ()))
    detections = read_detections(folder, kind, layout, size=size, names=names)
    info = probed or _declared_info(declared, detections)
    reading = AS_THEY_ARE
    if probed is not None and video is not None and not declared.detected:
        placed = kind in IN_SHARES
        reading = keypoint_reading.reading_of(
            detections, probed, video, folder, used=declared.frames, placed=placed
        )
    elif probed is None:
        reading = keypoint_reading.reading_without_video(detections, size)
    detections = reading.read(detections, info.frame_count, layout)
    frames = _used_frames(declared, info.frame_count, file)
    time_s = None if video is None else _uneven_times_s(video, info, frames)
    people_of = dict(zip(detections.frames.tolist(), detections.people, strict=True))
    nobody = np.zeros((0, *detections.people[0].shape[1:]))
    people = tracked_people.TrackedVideo(
        id=declared.id,
        people=[people_of.get(int(frame), nobody) for frame in frames],
        frames=frames,
        size=info.size,
        fps=info.fps if time_s is None else 1 / typical_step_s(time_s),
        layout=layout,
        focal_px=declared.focal_px or float(max(info.size)),
        ranked=[],
        person=declared.person,
    )
    return DetectedVideo(
        declared,
        folder,
        video,
        kind,
        people,
        time_s=time_s,
        reading=reading,
        remarks=(*_remarks(info), *reading.words),
        mirrored=info.display is not None and info.display.mirrored,
    )


def _remarks(info: VideoInfo) -> Iterator[str]:
    """What is unusual in how a file is shown."""
    if info.slowed != 1.0:
        slower = info.slowed > 1
        times = f"{max(info.slowed, 1 / info.slowed):.3g} times {'slower' if slower else 'faster'}"
        yield f"the time stamps play it {times} than it was taken: read at {info.fps:.4g} frames/s"
    if info.display is not None and info.display.aspect != 1.0:
        stored, shown = ("{} x {}".format(*size) for size in (info.display.stored, info.size))
        yield f"the pixels of the file ({stored}) are not square: read as {shown}"
    if info.display is not None and info.display.mirrored:
        yield "the picture is shown in a mirror, as the file says"


def _uneven_times_s(
    video: Path, info: VideoInfo, frames: Int64[np.ndarray, " T"]
) -> Float[np.ndarray, " T"] | None:
    """Presentation times of the used frames; None where these have the constant rate `info.fps`."""
    times = variable_times_s(video, info)
    if times is None or is_constant_rate(times[frames], info.fps):
        return None
    return times[frames]


def _declared_info(declared: Declaration, detections: DetectedPeople) -> VideoInfo:
    """Frame rate and size as action.yaml declares them, for keypoints without a video file."""
    assert declared.fps is not None
    assert declared.size is not None
    return VideoInfo(declared.fps, declared.size, int(detections.frames[-1]) + 1)


def _used_frames(declared: Declaration, count: int, file: Path) -> Int64[np.ndarray, " T"]:
    """Source frame numbers."""
    first, stop = declared.frames or (0, count)
    if stop > count:
        raise ValueError(
            f"{file}: videos.{declared.id}.frames: expected at most [0, {count}], as the clip has "
            f"{count} frames, got [{first}, {stop}]"
        )
    if stop - first < LEAST_FRAMES:
        raise ValueError(
            f"{file}: videos.{declared.id}.frames: expected at least {LEAST_FRAMES} frames, as "
            f"fewer have no motion, got {stop - first}; remove {declared.id}, or use more of it"
        )
    if stop - first > MAX_FRAMES:
        raise ValueError(
            f"{file}: videos.{declared.id}.frames: expected at most {MAX_FRAMES:,} frames, got "
            f"{stop - first:,}; if the detections are numbered by milliseconds, number them by "
            f"frames; of a long clip, use a part: frames: [first, one past last]"
        )
    return np.arange(first, stop, dtype=np.int64)


def tracked_video(
    declared: Declaration,
    folder: Path | None,
    video: Path | None,
    action_file: Path,
    params: KeypointsParams,
) -> DetectedVideo:
    """Everybody in a video, followed, and the declared performer among them.

    Arguments and errors as of `followed_video`; besides, ValueError when nobody is where
    action.yaml says that the performer is.
    """
    video_people = followed_video(declared, folder, video, action_file, params)
    tracked_people.declared_row(video_people.people, action_file)
    return video_people


def followed_video(
    declared: Declaration,
    folder: Path | None,
    video: Path | None,
    action_file: Path,
    params: KeypointsParams,
    *,
    every_shot: bool = False,
) -> DetectedVideo:
    """Everybody in a video, followed.

    Args:
        folder: the detections; None where the detector passed the video over.
        video: the file, None where there is none.
        every_shot: follow them through all shots, as for who chooses one.

    Raises:
        ValueError: a file or a declaration is wrong, or nobody is in the used frames.
    """
    if folder is None:
        assert video is not None
        raise ValueError(why_not_detected(video))
    detected = read_people(declared, folder, video, action_file)
    frames, size, fps = detected.people.frames, detected.people.size, detected.people.fps
    survey = None if video is None else survey_video(video, frames, size, fps)
    if survey is not None and not every_shot:
        holding = None if declared.person is None else declared.person.frame
        counts = [len(people) for people in detected.people.people]
        inside = tracked_people.longest_shot(survey.cuts, frames, counts, holding)
        detected, survey = _inside(detected, survey, *inside)
        frames = detected.people.frames
    people = tracked_people.track_people(detected.people, video, params)
    if not people.ranked:
        raise ValueError(
            f"{folder}: expected a person in frames {frames[0]} to {frames[-1]}, found nobody with "
            f"joints above confidence {params.min_confidence}; check the detections of "
            f"{declared.id} and its `frames` in action.yaml"
        )
    return replace(detected, people=people, survey=survey)


def _inside(
    detected: DetectedVideo, survey: VideoSurvey, first: int, stop: int
) -> tuple[DetectedVideo, VideoSurvey]:
    """A video from one frame to before another: the others are of another shot."""
    people, frames = detected.people, detected.people.frames
    used = slice(first - int(frames[0]), stop - int(frames[0]))
    out = [*range(frames[0], first), *range(stop, frames[-1] + 1)]
    if not out:
        return detected, survey
    spans = " and ".join(f"{a} to {b}" if b > a else f"{a}" for a, b in _spans(out))
    remark = (
        f"the picture of frame{'s' if len(out) > 1 else ''} {spans} is of another shot: left out"
    )
    time_s = None if detected.time_s is None else detected.time_s[used]
    detected = replace(
        detected,
        people=replace(people, people=people.people[used], frames=frames[used]),
        time_s=time_s,
        remarks=(*detected.remarks, remark),
    )
    return detected, VideoSurvey([], survey.damaged[used])


def _spans(numbers: list[int]) -> list[tuple[int, int]]:
    """First and last of each run of consecutive numbers."""
    inside = np.zeros(numbers[-1] - numbers[0] + 1, bool)
    inside[np.array(numbers) - numbers[0]] = True
    return [(numbers[0] + a, numbers[0] + b) for a, b in runs(inside)]


def performer_keypoints(
    video: DetectedVideo, performer: PerformerKeypoints, params: KeypointsParams
) -> VideoKeypoints:
    """A video's entry of the artifact, at a constant rate. ValueError when the performer is not in
    its picture."""
    declared, people = video.declared, video.people
    probed = video.video is not None
    keypoint_reading.check_fits_picture(performer.xy_px, people.size, video.folder, probed=probed)
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
        note="; ".join(part for part in (performer.note, *video.remarks) if part),
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
