"""Recordings that are there twice, named."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from imocap_core.artifacts.schemas import VideoKeypoints
from imocap_core.verdict.findings import Finding, listed
from imocap_core.verdict.limbs import TWINS, limbs_px
from imocap_core.verdict.same_take import SameTake, same_take


def take_findings(videos: Sequence[VideoKeypoints]) -> list[Finding]:
    """Videos that repeat another video's recording, and those that may."""
    findings = []
    repeating: set[str] = set()
    for first, second in combinations(videos, 2):
        if second.id in repeating:
            continue
        fps = (second.fps, first.fps)
        take = same_take(limbs_px(second), limbs_px(first), fps, TWINS)
        if take is None:
            continue
        if take.certain:
            repeating.add(second.id)
        findings.append(_finding(second, first, take))
    return findings


def said_first(timing: str, findings: Sequence[Finding], count: int) -> str:
    """The first sentence of a verdict, which begins with recordings that are there twice.

    Args:
        timing: what it says otherwise; findings: `take_findings` among them; count: of all videos.
    """
    takes = [f for f in findings if f.kind == "same take"]
    if not takes:
        return timing
    copies, views = listed([f"{f.video} is {f.brief}" for f in takes]), count - len(takes)
    if views == 1:
        return f"{copies}: {count} videos are one view, and nothing checks the result."
    timing = timing.replace("The timing", "the timing", 1)
    return f"{copies}, so {count} videos are {views} views; {timing}"


def _finding(video: VideoKeypoints, other: VideoKeypoints, take: SameTake) -> Finding:
    speed = take.rate * video.fps / other.fps
    how = [] if 0.97 < speed < 1.03 else [f"played at {speed:.2g} times its speed"]
    how += ["mirrored"] if take.mirrored else []
    again = f" ({', '.join(how)})" if how else ""
    if not take.certain:
        return Finding(
            "remark",
            video.id,
            f"may be the same recording as {other.id}{again}, or a performance very much like it, "
            "from the same place",
            f"may be the same recording as {other.id}",
            f"if it is a copy, remove it or {other.id} from action.yaml: it adds no view",
        )
    return Finding(
        "same take",
        video.id,
        f"the same recording as {other.id}{again}: it adds no view, and what both agree on is no "
        "confirmation",
        f"the same recording as {other.id}",
        f"remove it or {other.id} from action.yaml",
    )
