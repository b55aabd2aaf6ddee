"""Events of a motion: foot contacts, largest speeds of joints, turning points of joint angles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from imocap_core.sequences import runs

SPEED_WINDOW_S = 0.1  # over which a speed is the slope of a parabola
RESTS_M_S, EDGE_M_S, MOVES_M_S = 0.2, 0.3, 0.5  # speeds of a foot; its contact changes at the edge
LIFTED_M = 0.2  # a foot this much above the lower one does not stand, however still it is
LEAST_CONTACT_S = 0.1  # shorter contacts, and shorter gaps in one, are none
PEAK_SPEED_M_S, PEAK_SPEED_SHARE = 0.5, 0.2  # least prominence: this, and of the largest speed
SPEED_SD_PER_S, SPEED_SD_SHARE = 4.5, 0.1  # of a place's error along the path, of the speed
PEAK_ANGLE_DEG, PEAK_ANGLE_SDS = 10.0, 2.0  # least prominence: this, and standard deviations


Kind = Literal["contact_begin", "contact_end", "fastest", "largest", "smallest"]
Unit = Literal["", "m/s", "deg"]


@dataclass(frozen=True)
class MotionEvent:
    """Something that happens at one moment of a video.

    Attributes:
        kind: contact_begin and contact_end of a foot; fastest: a joint's speed has a peak; largest
            and smallest: an angle turns.
        name: of the foot's side, the joint, or the angle.
        index: the moment, a fractional position among the frames.
        earliest, latest: bounds of the moment. Of a contact: between them the foot changes from
            certainly moving to certainly resting, or back. Of a speed or an angle: it is within one
            standard deviation of its extreme there. NaN where nothing tells.
        value: the joint's speed (m/s) or the angle (deg); NaN of contacts. unit: of value.
        sd: standard deviation of value; NaN where unknown.
    """

    kind: Kind
    name: str
    index: float
    earliest: float
    latest: float
    value: float
    sd: float
    unit: Unit


def foot_contact_events(
    feet_m: Mapping[str, Float[np.ndarray, "T 2 3"]],
    heights_m: Mapping[str, np.ndarray],
    fps: float,
) -> list[MotionEvent]:
    """Where contacts of the feet with the ground begin and end.

    A foot is in contact while its slower point rests and it is not `LIFTED_M` above the other foot.
    Contacts that the video's first or last frame cuts off have no beginning or end.

    Args:
        feet_m: per side its ankle and the ball of its foot. heights_m: (T,) per side, of the lower
            of these.
    """
    events = []
    for side, spans in foot_contacts(feet_m, heights_m, fps).items():
        speed = _foot_speed(feet_m[side], fps)
        for first, last in spans:
            if first > 0:
                events.append(_edge("contact_begin", side, speed, first, -1))
            if last < len(speed) - 1:
                events.append(_edge("contact_end", side, speed, last, 1))
    return events


def foot_contacts(
    feet_m: Mapping[str, Float[np.ndarray, "T 2 3"]],
    heights_m: Mapping[str, np.ndarray],
    fps: float,
) -> dict[str, list[tuple[int, int]]]:
    """First and last frame of every contact of each side, as of `foot_contact_events`."""
    lowest = np.min(list(heights_m.values()), axis=0)
    return {
        side: list(_contacts(_foot_speed(feet, fps), heights_m[side] - lowest < LIFTED_M, fps))
        for side, feet in feet_m.items()
    }


def _foot_speed(feet_m: Float[np.ndarray, "T 2 3"], fps: float) -> Float[np.ndarray, " T"]:
    """Speed of the slower point of a foot, m/s."""
    speeds = [speeds_m_s(feet_m[:, k], fps) for k in range(feet_m.shape[1])]
    return np.asarray(np.min(speeds, axis=0))


def speeds_m_s(path_m: Float[np.ndarray, "T 3"], fps: float) -> Float[np.ndarray, " T"]:
    """Speed of a point over time, m/s, smoothed over `SPEED_WINDOW_S`; NaN of too few frames."""
    return np.asarray(np.linalg.norm(_velocity(path_m, fps), axis=1))


def _velocity(path_m: Float[np.ndarray, "T 3"], fps: float) -> Float[np.ndarray, "T 3"]:
    """Slope of the parabola over `SPEED_WINDOW_S`; NaN of too few frames."""
    width = max(5, 2 * round(SPEED_WINDOW_S * fps / 2) + 1)
    if len(path_m) < width:
        return np.full(path_m.shape, np.nan)
    from scipy.signal import savgol_filter  # takes a second to import, which most runs do not need

    return np.asarray(savgol_filter(path_m, width, 2, deriv=1, delta=1 / fps, axis=0))


def speed_spreads_m_s(
    path_m: Float[np.ndarray, "T 3"],
    covariance_mm2: Float[np.ndarray, "T 3 3"],
    fps: float,
    per_s: float = SPEED_SD_PER_S,
    share: float = SPEED_SD_SHARE,
) -> Float[np.ndarray, " T"]:
    """Standard deviation of the speed of a point, m/s, from the covariance of its place.

    Errors of a place persist over neighbouring frames: a speed errs by `per_s` (1/s) times what the
    place errs along its path, and by a share of itself, as changes are smoothed. Both were fitted
    to training clips (tools/fit_speed_spread.py).
    """
    velocity = _velocity(path_m, fps)
    speed = np.linalg.norm(velocity, axis=1)
    along = velocity / np.maximum(speed, 1e-9)[:, None]
    place_m2 = np.einsum("ti,tij,tj->t", along, covariance_mm2 * 1e-6, along)
    return np.asarray(np.sqrt(per_s**2 * place_m2 + (share * speed) ** 2))


def speed_events(
    paths_m: Mapping[str, Float[np.ndarray, "T 3"]],
    fps: float,
    sd_m_s: Mapping[str, Float[np.ndarray, " T"]],
) -> list[MotionEvent]:
    """Peaks of joints' speeds; sd_m_s: of those speeds of which it is known."""
    events = []
    for name, path in paths_m.items():
        speed = speeds_m_s(path, fps)
        if np.isfinite(speed).all():
            least = max(PEAK_SPEED_M_S, PEAK_SPEED_SHARE * speed.max(initial=0.0))
            sd = sd_m_s.get(name, np.full(len(speed), np.nan))
            events += _turning_points("fastest", name, speed, sd, least, "m/s")
    return events


def angle_events(
    angles_deg: Mapping[str, Float[np.ndarray, " T"]], sd_deg: Mapping[str, Float[np.ndarray, " T"]]
) -> list[MotionEvent]:
    """Where joint angles turn: their peaks and valleys of at least `PEAK_ANGLE_DEG`, and of
    `PEAK_ANGLE_SDS` standard deviations where these are known."""
    events = []
    for name, angle in angles_deg.items():
        sd = sd_deg.get(name, np.full(len(angle), np.nan))
        for first, last in runs(np.isfinite(angle)):
            part, sds = angle[first : last + 1], sd[first : last + 1]
            middle = np.median(sds[np.isfinite(sds)]) if np.isfinite(sds).any() else 0.0
            least = max(PEAK_ANGLE_DEG, PEAK_ANGLE_SDS * middle)
            events += _turning_points("largest", name, part, sds, least, "deg", first)
            events += _turning_points("smallest", name, part, sds, least, "deg", first)
    return events


def _turning_points(
    kind: Kind,
    name: str,
    curve: Float[np.ndarray, " T"],
    sd: Float[np.ndarray, " T"],
    least: float,
    unit: Unit,
    first: int = 0,
) -> list[MotionEvent]:
    """Peaks of a curve (valleys of a `smallest`) of a least prominence, within the frames in which
    it is one standard deviation from its extreme at most; first: the curve's first frame."""
    sign = -1 if kind == "smallest" else 1
    events = []
    for index, value in _peaks(sign * curve, least):
        spread = float(sd[round(index)])
        low, high = _within(sign * curve, index, value - spread)
        moments = first + index, first + low, first + high
        events.append(MotionEvent(kind, name, *moments, sign * value, spread, unit))
    return events


def _contacts(
    speed: Float[np.ndarray, " T"], low: Bool[np.ndarray, " T"], fps: float
) -> list[tuple[int, int]]:
    """First and last frame of each contact: slower than the edge, at rest at some moment."""
    shortest = round(LEAST_CONTACT_S * fps)
    slow = runs((speed < EDGE_M_S) & low, least=max(shortest, 1), gap=shortest)
    return [(a, b) for a, b in slow if (speed[a : b + 1] < RESTS_M_S).any()]


def _edge(
    kind: Kind, side: str, speed: Float[np.ndarray, " T"], inner: int, step: int
) -> MotionEvent:
    """The moment at which a foot's speed crosses the edge beyond the contact's last frame on one
    side; and where it crosses the speeds of rest and of movement."""
    outer = inner + step
    change = speed[outer] - speed[inner]
    share = (EDGE_M_S - speed[inner]) / change if change > 0 else 0.5
    index = inner + step * float(np.clip(share, 0, 1))
    rests = _first(speed < RESTS_M_S, inner, -step)
    moves = _first(speed > MOVES_M_S, outer, step)
    earliest, latest = sorted((float(rests), float(moves)))
    return MotionEvent(kind, side, index, earliest, latest, np.nan, np.nan, "")


def _first(flags: Bool[np.ndarray, " T"], start: int, step: int) -> int:
    """The first frame from `start` on, forward or back, with a flag; the last one if none has."""
    t = start
    while not flags[t] and 0 <= t + step < len(flags):
        t += step
    return t


def _peaks(curve: Float[np.ndarray, " T"], least: float) -> list[tuple[float, float]]:
    """Place and height of each peak of a least prominence, by the parabola through its top."""
    from scipy.signal import find_peaks

    tops, _ = find_peaks(curve, prominence=least)
    peaks = []
    for t in tops:
        before, top, after = curve[t - 1], curve[t], curve[t + 1]
        bend = before - 2 * top + after
        shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
        peaks.append((float(t + shift), float(top - 0.25 * (before - after) * shift)))
    return peaks


def _within(curve: Float[np.ndarray, " T"], index: float, least: float) -> tuple[float, float]:
    """The frames around a peak between which a curve stays above a value; NaN where that is."""
    if not np.isfinite(least):
        return np.nan, np.nan
    first = last = round(index)
    while first > 0 and curve[first - 1] >= least:
        first -= 1
    while last < len(curve) - 1 and curve[last + 1] >= least:
        last += 1
    return min(float(first), index), max(float(last), index)
