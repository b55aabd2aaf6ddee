"""Hints for the synchronisation: anchors and forbidden spans, sound, the clock of one event."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from jaxtyping import Float

from imocap_core.artifacts.schemas import Keypoints, Sync, SyncMap, VideoKeypoints
from imocap_core.io.video import read_sound
from imocap_core.motion.event_clock import Clock, clock_of
from imocap_core.pipeline.action import AnchorEntry, ForbiddenEntry
from imocap_core.sync import Anchor, Hints, sound


def hints_of(
    anchors: Sequence[AnchorEntry],
    forbidden: Sequence[ForbiddenEntry],
    keypoints: Keypoints,
    file: str,
) -> Hints:
    """Hints by index of video and used frame; `file` names action.yaml in messages.

    What is declared of a video that was left out is not used.

    Raises:
        ValueError: names every anchor on a frame that is not used, and every span without any.
    """
    index = {v.id: k for k, v in enumerate(keypoints.videos)}
    videos = {v.id: v for v in keypoints.videos}
    faults: list[str] = []
    ties: list[Anchor] = []
    for n, anchor in enumerate(anchors):
        indices = {v: _used_index(videos[v], f) for v, f in anchor.frames.items() if v in videos}
        faults += [
            f"anchors.{n}: expected a used frame of {v}, {_range(videos[v])}, got "
            f"{anchor.frames[v]}"
            for v, t in indices.items()
            if t is None
        ]
        ends = [(index[v], t) for v, t in indices.items() if t is not None]
        ties += [Anchor(a, t, b, float(s), anchor.hard) for (a, t), (b, s) in combinations(ends, 2)]
    spans = []
    for n, entry in enumerate(forbidden):
        if entry.video not in videos:
            continue
        video = videos[entry.video]
        first, stop = (int(f) for f in np.searchsorted(video.frames, entry.frames))
        if first >= stop:
            faults.append(
                f"forbidden.{n}: expected frames of {video.id} within {_range(video)}, got "
                f"{list(entry.frames)}"
            )
        spans.append((index[entry.video], first, stop))
    if faults:
        raise ValueError("\n".join(f"{file}: {fault}" for fault in faults))
    return Hints(tuple(ties), tuple(spans))


def _used_index(video: VideoKeypoints, frame: int) -> int | None:
    """The index of the used frame that is nearest to a source frame among them."""
    if not video.frames[0] <= frame <= video.frames[-1]:
        return None
    return int(np.abs(video.source_frames - frame).argmin())


def _range(video: VideoKeypoints) -> str:
    return f"{int(video.frames[0])} to {int(video.frames[-1])}"


ANCHOR_EVERY_S, MOST_ANCHORS = 0.1, 40  # between two videos
EDGE_S = 0.1  # of the overlap, without anchors


@dataclass(frozen=True)
class EventSound:
    """start_s: when each video began, NaN where its sound does not tell; notes: sentences."""

    start_s: Float[np.ndarray, " M"]
    notes: list[str]


def event_sound(files: Mapping[str, Path | None], keypoints: Keypoints) -> EventSound:
    """What the sound of the videos of one event tells.

    Args:
        files: by video, None where there is none.
    """
    ids = [video.id for video in keypoints.videos]
    envelopes: list[Float[np.ndarray, " _"] | None] = []
    for video in ids:
        file = files.get(video)
        samples = None if file is None or not file.is_file() else read_sound(file, sound.RATE_HZ)
        envelopes.append(None if samples is None else sound.onset_envelope(samples))
    pairs = sound.pair_offsets(envelopes)
    start_s = sound.consistent_offsets(pairs, len(ids))
    silent = [i for i, e in zip(ids, envelopes, strict=True) if e is None or not e.any()]
    return EventSound(start_s, _notes(ids, silent, pairs, start_s))


def with_sound(hints: Hints, start_s: Float[np.ndarray, " M"], keypoints: Keypoints) -> Hints:
    """The hints and, between every two videos whose offset is known, soft anchors; what the user
    has anchored in two videos stays as it is."""
    anchored = {frozenset((anchor.a, anchor.b)) for anchor in hints.anchors}
    ties: list[Anchor] = []
    for a, b in combinations(range(len(keypoints.videos)), 2):
        if np.isfinite(start_s[[a, b]]).all() and frozenset((a, b)) not in anchored:
            first, second = keypoints.videos[a], keypoints.videos[b]
            ties += _anchors(a, first, b, second, float(start_s[b] - start_s[a]))
    forbidden = hints.forbidden_frames([len(v.frames) for v in keypoints.videos])
    free = [
        x for x in ties
        if not forbidden[x.a][x.frame_a] and not forbidden[x.b][round(x.frame_b)]
    ]  # fmt: skip
    return replace(hints, anchors=(*hints.anchors, *free))


def _anchors(
    a: int, first: VideoKeypoints, b: int, second: VideoKeypoints, offset_s: float
) -> list[Anchor]:
    """Anchors at equal intervals over what both videos show."""
    begin = max(first.time_s[0], second.time_s[0] + offset_s) + EDGE_S
    end = min(first.time_s[-1], second.time_s[-1] + offset_s) - EDGE_S
    ties = []
    for time in np.arange(begin, end, max(ANCHOR_EVERY_S, (end - begin) / MOST_ANCHORS)):
        frame = int(np.abs(first.time_s - time).argmin())
        counterpart = np.interp(
            first.time_s[frame] - offset_s, second.time_s, np.arange(len(second.time_s))
        )
        ties.append(Anchor(a, frame, b, float(counterpart)))
    return ties


def _notes(
    ids: list[str],
    silent: list[str],
    pairs: Mapping[tuple[int, int], sound.PairOffset],
    start_s: Float[np.ndarray, " M"],
) -> list[str]:
    notes = []
    tied = [v for v in range(len(ids)) if np.isfinite(start_s[v])]
    if tied:
        first = tied[0]
        begun = ", ".join(f"{ids[v]} {start_s[v] - start_s[first]:+.2f} s" for v in tied[1:])
        notes.append(f"by their sound, against the beginning of {ids[first]}: {begun}")
    if silent:
        notes.append(f"{', '.join(silent)}: no sound, so the pictures alone tell the timing")
    for (a, b), pair in pairs.items():
        if a in tied and b in tied:
            continue
        names = f"{ids[a]} and {ids[b]}"
        if pair.common:
            notes.append(
                f"{names}: their sound repeats itself (offsets of {pair.offset_s:+.2f} s and "
                f"{pair.other_s:+.2f} s fit nearly alike), so it is not used"
            )
        else:
            notes.append(f"{names}: no sound in common is recognised, so it is not used")
    return notes


def with_one_offset(
    sync: Sync, keypoints: Keypoints, start_s: Float[np.ndarray, " M"] | None
) -> Sync:
    """The correspondences of one event: every video's frames at one offset and rate.

    Args:
        start_s: (M,) when each video file began, by its sound, or None.
    """
    reference = sync.ids.index(sync.reference)
    first_s = None
    if start_s is not None:
        first_s = start_s + [float(video.time_s[0]) for video in keypoints.videos]
    clock = clock_of(
        [m.reference_frame for m in sync.maps],
        [m.confidence for m in sync.maps],
        [video.fps for video in keypoints.videos],
        reference,
        first_s,
    )
    return on_lines(sync, clock, sync.ids, keypoints)


def on_lines(sync: Sync, clock: Clock, ids: Sequence[str], keypoints: Keypoints) -> Sync:
    """The maps and phases of a clock; those of videos that are excluded, or not its own, stay.

    ids: of the clock's videos.
    """
    places = {name: k for k, name in enumerate(ids)}
    reference = sync.ids.index(sync.reference)
    last, fps = sync.lengths[reference] - 1, keypoints.videos[reference].fps
    maps, phases = list(sync.maps), {}
    for v, old in enumerate(sync.maps):
        k = places.get(old.id)
        if k is None or old.id in sync.excluded or not np.isfinite(clock.offset[k]):
            continue
        frames = clock.reference_frames(k, sync.lengths[v], last)
        confidence = np.where(np.isfinite(frames), clock.agreement[k], 0.0)
        maps[v] = SyncMap(id=old.id, reference_frame=frames, confidence=confidence)
        phases[old.id] = clock.moments(k, sync.lengths[v]) / fps
    if sync.trust is None:
        return sync.model_copy(update={"maps": maps})
    begun = {v.id: v.phase_s for v in sync.trust.videos}[sync.reference][0]
    videos = [
        v.model_copy(update={"phase_s": begun + phases[v.id]}) if v.id in phases else v
        for v in sync.trust.videos
    ]
    trust = sync.trust.model_copy(update={"videos": videos})
    return sync.model_copy(update={"maps": maps, "trust": trust})
