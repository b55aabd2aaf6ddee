"""Everybody's tracks in each video, and who performs; videos and parts that cannot be used.

Videos that can be used: one whose declaration or files are wrong is left out, and named. The
others' result is then the one that they would have without it. Where fewer than two would remain,
all faults are one error: nobody who gave several videos wants the motion of one.

The declaration in action.yaml comes first, then the score (presence x size x motion); where several
people have similar scores, agreement with the people of the other videos decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Int, Int64

from imocap_core.artifacts.schemas import LeftOutVideo
from imocap_core.body.layouts import layout_names
from imocap_core.io.video import read_rgb_of
from imocap_core.lifter.infer import lift
from imocap_core.lifter.lifter_network import can_lift, joints_seen, load_lifter, to_common
from imocap_core.params import KeypointsParams
from imocap_core.people import appearance, left_right
from imocap_core.people.performer import (
    FramePlace,
    PerformerKeypoints,
    SeenMotion,
    choose_by_agreement,
    declared_performer,
    performer_of,
    rank,
    ranked_tracks,
    rivals,
    row_at_place,
    row_of_number,
)
from imocap_core.people.tracking import PersonTrack, lost_frames
from imocap_core.pipeline.action import Person

LEAST_VIDEOS = 2


Result = TypeVar("Result")
Faults = dict[str, str]  # video id -> what is wrong, and what to do


def of_usable(
    ids: Iterable[str], solve: Callable[[str], Result], faults: Faults
) -> dict[str, Result]:
    """`solve` of every video for which it raises no ValueError; the others go into `faults`.

    ValueError with all faults when too few videos remain.
    """
    results = {}
    for video in ids:
        try:
            results[video] = solve(video)
        except ValueError as error:
            faults[video] = str(error)
    if faults and len(results) < LEAST_VIDEOS:
        several = [f"{video}: {fault}" for video, fault in faults.items()]
        raise ValueError("\n".join(several if len(faults) > 1 else faults.values()))
    return results


def left_out_videos(
    faults: Mapping[str, str], names: Mapping[Path, str]
) -> list[LeftOutVideo] | None:
    """The videos with faults; None without any. names: how the action calls files and folders,
    because artifacts hold no absolute path."""
    videos = []
    for video, fault in faults.items():
        reason = "; ".join(fault.splitlines())
        for path in sorted(names, key=lambda p: len(str(p)), reverse=True):
            reason = reason.replace(str(path), names[path])
        videos.append(LeftOutVideo(id=video, reason=reason))
    return videos or None


def longest_shot(
    cuts: Sequence[int],
    frames: Int[np.ndarray, " T"],
    people: Sequence[int],
    declared: int | None = None,
) -> tuple[int, int]:
    """First and one past the last frame of the shot with the most frames that show somebody, or of
    the one in which somebody is declared.

    Args:
        cuts: frames with which a new shot begins. people: how many are detected in each frame.
        declared: the frame for which action.yaml tells where the performer is.
    """
    edges = [int(frames[0]), *cuts, int(frames[-1]) + 1]
    shown = np.concatenate([[0], np.cumsum(np.array(people) > 0)])
    shots = list(pairwise(edges))
    holding = [shot for shot in shots if declared is not None and shot[0] <= declared < shot[1]]
    return max(holding or shots, key=lambda e: shown[e[1] - edges[0]] - shown[e[0] - edges[0]])


APPEARANCE_STEP_S = 0.2  # between frames in which appearances are measured
LEAST_SIZE_PX = 1.0
SWAPPING_LAYOUTS = ("mediapipe33", "blazepose33")  # of detectors that take backs for fronts
NEGLIGIBLE = 0.03  # of the best score: people with less are false detections or far away


@dataclass(frozen=True)
class TrackedVideo:
    """One video: everybody detected in its used frames, and their tracks with scores."""

    id: str
    people: list[Float[np.ndarray, "_ K 3"]]  # per frame
    frames: Int64[np.ndarray, " T"]
    size: tuple[int, int]
    fps: float
    layout: str
    focal_px: float
    ranked: list[tuple[float, PersonTrack]]
    person: Person | None = None


def track_people(
    detected: TrackedVideo, video: Path | None, params: KeypointsParams
) -> TrackedVideo:
    """With everybody's tracks: by motion and, where there is a video file, by appearance."""
    ranked = ranked_tracks(
        detected.people,
        detected.size,
        detected.fps,
        min_confidence=params.min_confidence,
        max_gap_s=params.max_gap_s,
    )
    several = len(ranked) > 1 and ranked[1][0] > NEGLIGIBLE * ranked[0][0]  # mistakes would matter
    if video is not None and params.looks and several:
        tracks = [track for _, track in ranked]
        appearances = _appearances_of(video, detected, tracks)
        tracks, appearances = appearance.swap_after_meetings(tracks, appearances)
        tracks, _ = appearance.join_by_appearance(tracks, appearances)
        ranked = rank(tracks, len(detected.people), detected.size)
    return replace(detected, ranked=ranked)


def choose_performers(
    videos: Sequence[TrackedVideo], file: Path, params: KeypointsParams
) -> list[PerformerKeypoints]:
    """The performer of every video. ValueError when a declared person is not there.

    file: the action.yaml, for messages.
    """
    declared = [declared_row(video, file) for video in videos]
    rows = [0 if row is None else row for row in declared]
    remarks = ["" for _ in videos]
    if params.performer == "agreement":
        rows, remarks = _rows_by_agreement(videos, declared)
    return [
        _cleaned(video, _performer(video, row, d is not None, remark), params)
        for video, row, d, remark in zip(videos, rows, declared, remarks, strict=True)
    ]


def _performer(video: TrackedVideo, row: int, is_declared: bool, remark: str) -> PerformerKeypoints:
    if is_declared:
        return declared_performer(video.ranked, row, video.people)
    performer = performer_of(video.ranked, row, video.people)
    return replace(performer, note=performer.note + remark) if remark else performer


def declared_row(video: TrackedVideo, file: Path) -> int | None:
    """Row of the track that action.yaml declares; None when it declares none. ValueError when
    nobody is where it says."""
    person = video.person
    if person is None:
        return None
    try:
        if person.track is not None:
            return row_of_number(video.ranked, person.track)
        frame = int(person.frame or 0) - int(video.frames[0])
        return row_at_place(video.ranked, FramePlace(frame, person.point_px, person.box))
    except ValueError as error:
        raise ValueError(
            f"{file}: videos.{video.id}.person: {error} (boxes x0 y0 x1 y1 in pixels; "
            f"`imocap people` lists everybody)"
        ) from None


def _rows_by_agreement(
    videos: Sequence[TrackedVideo], declared: Sequence[int | None]
) -> tuple[list[int], list[str]]:
    """Rows of the performers, and remarks where agreement overruled the score."""
    candidates = [
        [row] if row is not None else rivals([score for score, _ in video.ranked]) or [0]
        for video, row in zip(videos, declared, strict=True)
    ]
    rows, remarks = [each[0] for each in candidates], ["" for _ in videos]
    liftable = [v for v, video in enumerate(videos) if video.ranked and can_lift(video.layout)]
    if len(liftable) < 2 or all(len(candidates[v]) == 1 for v in liftable):
        return rows, remarks
    motions = [[_seen_motion(videos[v], row) for row in candidates[v]] for v in liftable]
    scores = [[videos[v].ranked[row][0] for row in candidates[v]] for v in liftable]
    for v, choice in zip(liftable, choose_by_agreement(scores, motions), strict=True):
        rows[v] = candidates[v][choice]
        if choice:
            remarks[v] = (
                f"; track {rows[v] + 1} was chosen instead of track 1, because its motion agrees "
                "with the other videos (`person` in action.yaml overrides this)"
            )
    return rows, remarks


def _seen_motion(video: TrackedVideo, row: int) -> SeenMotion:
    """3D joints of a track in the frames in which it is visible, and how well each is seen."""
    track = video.ranked[row][1]
    poses = np.full((track.frames[-1] - track.frames[0] + 1, *track.poses[0].shape), np.nan)
    poses[np.array(track.frames) - track.frames[0]] = np.stack(track.poses)
    rays = (poses[..., :2] - 0.5 * np.array(video.size)) / video.focal_px
    points, confidence = to_common(rays, np.nan_to_num(poses[..., 2]), video.layout)
    lifted = lift(load_lifter(), points, confidence, video.fps)
    shown = joints_seen(confidence, video.layout)
    return SeenMotion(lifted.joints[lifted.visible], shown[lifted.visible])


def _cleaned(
    video: TrackedVideo, performer: PerformerKeypoints, params: KeypointsParams
) -> PerformerKeypoints:
    """Without frames in which the body was lost, with left-right swaps undone, and remarks."""
    if performer.tracks_found == 0:
        return performer
    xy, confidence, note = performer.xy_px, performer.confidence, performer.note
    boxes = performer.box_px[:, 2:] - performer.box_px[:, :2]
    size = np.maximum(np.nan_to_num(np.hypot(*boxes.T), nan=0.0), LEAST_SIZE_PX)
    size = np.maximum(size, float(np.median(size)))
    names = layout_names(video.layout)
    if (lost := lost_frames(xy, size, names, video.fps)).any():
        xy = np.where(lost[:, None, None], np.nan, xy)
        confidence = np.where(lost[:, None], 0.0, confidence)
        note += f"; in {lost.sum()} frames the detector lost the body"
    if params.sides == "repair" or (params.sides == "auto" and video.layout in SWAPPING_LAYOUTS):
        limbs, count = left_right.limbs_of(names), 0
        for pairs in limbs:
            frames = left_right.swapped_frames(xy, size, pairs, video.fps)
            xy, confidence = left_right.swap_sides(xy, confidence, frames, pairs)
            count += int(frames.sum())
        for pairs, frames in zip(
            limbs, left_right.swapped_arms_and_legs(xy, size, names), strict=False
        ):
            xy, confidence = left_right.swap_sides(xy, confidence, frames, pairs)
            count += int(frames.sum())
        note += f"; left and right of a limb put back in {count} frames" if count else ""
    return replace(performer, xy_px=xy, confidence=confidence, note=note)


def _appearances_of(
    video: Path, detected: TrackedVideo, tracks: Sequence[PersonTrack]
) -> list[appearance.Appearances]:
    """The appearance of everybody tracked, every `APPEARANCE_STEP_S`."""
    step = max(1, round(APPEARANCE_STEP_S * detected.fps))
    first, last = int(detected.frames[0]), int(detected.frames[-1])
    appearances: list[dict[int, np.ndarray]] = [{} for _ in tracks]
    poses = [dict(zip(track.frames, track.poses, strict=True)) for track in tracks]
    for number, picture in read_rgb_of(video, range(first, last + 1, step)):
        frame = number - first
        for of_track, pose_in in zip(appearances, poses, strict=True):
            if frame in pose_in:
                of_track[frame] = appearance.appearance_of(picture, pose_in[frame])
    return list(appearances)
