"""Joint angles and events of a made action against those of its truth.

    python -m tools.measure_angles RESULT TRUTH

RESULT is artifacts/ACTION, TRUTH the action's truth.npz, in a world whose z points up. Angles: the
standard deviations that `imocap angles` states against the errors. Events: those of the estimated
motion are paired with those of the true one, of one kind and name, within `NEAR_S`.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import imocap
from imocap_core.biomechanics.events import MotionEvent
from imocap_core.conventions import SIDES
from imocap_core.io.truth import VideoTruth, read_truth
from imocap_core.result.video import VideoResult
from imocap_core.result.video_motion import video_angles, video_events

NEAR_S = 0.3
TRUE_UP = "z"
TITLES = (
    *("foot contacts", "fastest moments"),
    *("turning points, sd known", "turning points, sd unknown"),
)
FRAME = 0.5  # an interval of whole frames is known to half of one


@dataclass(frozen=True)
class Pair:
    """An event and the true one: error of its moment, whether the truth is within the interval that
    was stated, error of the value, and its standard deviation."""

    late_s: float
    within: bool
    value: float
    sd: float


def true_motion(video: VideoResult, truth: VideoTruth) -> VideoResult:
    """The video with its true motion in place of the estimated one."""
    assert truth.theta is not None
    assert truth.trans is not None
    assert truth.betas is not None
    assert truth.joints is not None
    return replace(
        video,
        theta=truth.theta,
        trans=truth.trans,
        betas=truth.betas,
        body_joints=truth.joints,
        joint_uncertainty=None,
        hands=None,
    )


def pair_up(
    events: Sequence[MotionEvent], truth: Sequence[MotionEvent], fps: float
) -> tuple[list[Pair], int, int]:
    """Pairs of events, how many true ones have none, and how many of ours."""
    pairs, free = [], list(events)
    for true in truth:
        near = [e for e in free if (e.kind, e.name) == (true.kind, true.name)]
        best = min(near, key=lambda e: abs(e.index - true.index), default=None)
        if best is None or abs(best.index - true.index) > NEAR_S * fps:
            continue
        free.remove(best)
        late = (best.index - true.index) / fps
        within = best.earliest - FRAME <= true.index <= best.latest + FRAME
        pairs.append(Pair(late, within, best.value - true.value, best.sd))
    return pairs, len(truth) - len(pairs), len(free)


def title_of(event: MotionEvent, spread_names: set[str]) -> str:
    """The group of an event; spread_names: angles that have a standard deviation."""
    if event.unit == "deg":
        return TITLES[2] if event.name in spread_names else TITLES[3]
    return TITLES[0] if event.unit == "" else TITLES[1]


def print_events(groups: dict[str, tuple[list[Pair], int, int]]) -> None:
    """A row each kind of events."""
    print(
        "\n| events | paired | missed | of ours alone | moment, median error | within its bounds |"
    )
    print("|---|---:|---:|---:|---:|---:|")
    for name, (pairs, missed, alone) in groups.items():
        if not pairs:
            continue
        late_ms = 1000 * np.median([abs(pair.late_s) for pair in pairs])
        bounded = any(pair.within for pair in pairs)
        share = f"{100 * np.mean([pair.within for pair in pairs]):.0f} %" if bounded else "unknown"
        print(f"| {name} | {len(pairs)} | {missed} | {alone} | {late_ms:.0f} ms | {share} |")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("result", type=Path)
    parser.add_argument("truth", type=Path)
    given = parser.parse_args(arguments)
    result = imocap.load(given.result).levelled("y")
    truth = read_truth(given.truth, {v.id: np.asarray(v.frames) for v in result})
    errors, spreads = defaultdict(list), defaultdict(list)
    groups: dict[str, tuple[list[Pair], int, int]] = {}
    for video in result:
        true = true_motion(video, truth.videos[video.id])
        ours, theirs = (
            video_angles(video, "y", result.ground.tilt_sd_deg),
            video_angles(true, TRUE_UP),
        )
        for name, sd in ours.sd_deg.items():
            away = (ours.angles_deg[name] - theirs.angles_deg[name] + 180) % 360 - 180
            if name == "pelvis_rotation":  # the truth's world has another direction ahead
                away = away - np.median(away)
            angle = name.split("_", 1)[1] if name.startswith(SIDES) else name
            errors[angle].append(away)
            spreads[angle].append(sd)
        both = video_events(video, ours), video_events(true, theirs, TRUE_UP)
        spread_names = set(ours.sd_deg)
        for title in TITLES:
            ours_of, theirs_of = (
                [e for e in events if title_of(e, spread_names) == title] for events in both
            )
            pairs, missed, alone = pair_up(ours_of, theirs_of, video.fps)
            before = groups.get(title, ([], 0, 0))
            groups[title] = before[0] + pairs, before[1] + missed, before[2] + alone
    print("| angle | error, RMS | standard deviation stated | normalised error |")
    print("|---|---:|---:|---:|")
    for name, parts in errors.items():
        away, sd = np.concatenate(parts), np.concatenate(spreads[name])
        finite = np.isfinite(away) & np.isfinite(sd)
        rms = [np.sqrt((x[finite] ** 2).mean()) for x in (away, sd, away / sd)]
        print(f"| `{name}` | {rms[0]:.1f} | {rms[1]:.1f} | {rms[2]:.2f} |")
    print_events(groups)


if __name__ == "__main__":
    main()
