"""keypoints: the performer's 2D joints in every used frame of every video."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from imocap_core.adapters.detected_people import DetectedVideo, performer_keypoints, tracked_video
from imocap_core.adapters.estimates import check_estimate
from imocap_core.adapters.tracked_people import (
    Faults,
    choose_performers,
    left_out_videos,
    of_usable,
)
from imocap_core.artifacts.schemas import Keypoints, VideoKeypoints
from imocap_core.cli import stage_main
from imocap_core.params import KeypointsParams, Params
from imocap_core.pipeline.action import DETECT, Declaration
from imocap_core.pipeline.stage import Context, Inputs


def run(ctx: Context, inputs: Inputs, params: Params) -> Keypoints:
    """Read the detections, track everybody, choose the performer; videos whose declaration,
    files or monocular estimate are wrong are left out."""
    _check_all_have_keypoints(ctx)
    faults: Faults = {}
    declared = {video.id: video for video in ctx.declarations()}
    videos = of_usable(declared, lambda i: _tracked(declared[i], ctx, params.keypoints), faults)
    solved: dict[str, VideoKeypoints] = {}
    while len(solved) < len(videos):  # again without those whose performer is not in the picture
        videos = {i: video for i, video in videos.items() if i not in faults}
        solved = of_usable(videos, _keypoints_by_id(videos, ctx, params.keypoints), faults)
    return Keypoints(videos=list(solved.values()), left_out=left_out_videos(faults, _names(ctx)))


def _keypoints_by_id(
    videos: dict[str, DetectedVideo], ctx: Context, params: KeypointsParams
) -> Callable[[str], VideoKeypoints]:
    """A function from a video's id to the keypoints of its performer, chosen among these videos."""
    people = [video.people for video in videos.values()]
    performers = choose_performers(people, ctx.action_file(), params)
    performer_of = dict(zip(videos, performers, strict=True))

    def of_video(video: str) -> VideoKeypoints:
        keypoints = performer_keypoints(videos[video], performer_of[video], params)
        check_estimate(ctx, keypoints)
        return keypoints

    return of_video


def _names(ctx: Context) -> dict[Path, str]:
    """How action.yaml calls the files and folders that messages name."""
    names = {ctx.action_file(): ctx.action_file().name}
    for declared in ctx.declarations():
        for path, name in (
            (ctx.detections(declared.id), declared.keypoints),
            (ctx.video(declared.id), declared.video),
            (ctx.initial(declared.id), declared.initial),
        ):
            if path is not None and name is not None:
                names[path] = f"detections of {declared.id}" if name == DETECT else name
    return names


def _check_all_have_keypoints(ctx: Context) -> None:
    """ValueError naming every video without keypoints."""
    given = [v for v in ctx.declarations() if not v.detected]
    without = [v.id for v in given if ctx.detections(v.id) is None]
    if without:
        raise ValueError(
            f"{ctx.action_file()}: no 2D keypoints for {', '.join(without)}: write `keypoints: "
            "detect` to run a detector, or run one such as OpenPose yourself and name its folder "
            "of JSON files (`imocap formats` lists what is read)"
        )


def _tracked(declared: Declaration, ctx: Context, params: KeypointsParams) -> DetectedVideo:
    order = [video.id for video in ctx.declarations()]
    ctx.progress(order.index(declared.id) / len(order), f"tracking people in {declared.id}")
    files = ctx.detections(declared.id), ctx.video(declared.id)
    return tracked_video(declared, *files, ctx.action_file(), params)


if __name__ == "__main__":
    raise SystemExit(stage_main("keypoints"))
