"""Events of made motions: contacts, fastest moments and turning points are where they were put."""

import csv
from pathlib import Path

import numpy as np
import pytest

from imocap_core.biomechanics.events import (
    EDGE_M_S,
    SPEED_SD_PER_S,
    SPEED_SD_SHARE,
    angle_events,
    foot_contact_events,
    speed_events,
    speed_spreads_m_s,
    speeds_m_s,
)
from imocap_core.io.writers.text_files import write_events_csv

FPS = 60.0
TIME = np.arange(120) / FPS


def step(starts_s: float, ends_s: float) -> np.ndarray:
    """(T,) a way of 0.8 m between two moments, that starts and stops smoothly."""
    share = np.clip((TIME - starts_s) / (ends_s - starts_s), 0, 1)
    return 0.8 * (share - np.sin(2 * np.pi * share) / (2 * np.pi))


def foot(way: np.ndarray, lift: np.ndarray | float = 0.0) -> np.ndarray:
    ankle = np.stack([way, 0.08 + lift + 0 * way, 0 * way], axis=1)
    return np.stack([ankle, ankle - [0, 0.06, 0]], axis=1)


def contacts(feet: dict[str, np.ndarray]) -> list[tuple[str, str, float]]:
    heights = {side: points[..., 1].min(axis=1) for side, points in feet.items()}
    events = foot_contact_events(feet, heights, FPS)
    for event in events:
        assert event.earliest <= event.index <= event.latest
        assert event.latest - event.earliest < 0.2 * FPS
        assert np.isnan(event.value)
    return [(event.kind, event.name, event.index / FPS) for event in events]


def test_a_step_ends_a_contact_and_begins_one() -> None:
    feet = {"left": foot(step(0.5, 1.0)), "right": foot(0 * TIME)}
    (end, off, left_s), (begin, on, lands_s) = sorted(contacts(feet), key=lambda e: e[2])
    assert (end, off, begin, on) == ("contact_end", "left", "contact_begin", "left")
    # the true speed passes the edge where 1.6 (1 - cos) = EDGE_M_S
    inward_s = 0.5 * np.arccos(1 - EDGE_M_S / 1.6) / (2 * np.pi)
    assert left_s == pytest.approx(0.5 + inward_s, abs=0.02)
    assert lands_s == pytest.approx(1.0 - inward_s, abs=0.02)


def test_a_foot_held_in_the_air_does_not_stand_and_jitter_ends_no_contact() -> None:
    rng = np.random.default_rng(0)
    jitter = 0.002 * rng.normal(size=(len(TIME), 2, 3))
    held = foot(0 * TIME, lift=0.4)
    assert contacts({"left": foot(0 * TIME) + jitter, "right": held}) == []
    lowered = foot(0 * TIME, lift=0.4 * (1 - step(0.8, 1.1) / 0.8))
    found = contacts({"left": foot(0 * TIME) + jitter, "right": lowered})
    assert [(kind, name) for kind, name, _ in found] == [("contact_begin", "right")]
    assert found[0][2] == pytest.approx(1.08, abs=0.05)


def test_the_fastest_moment_of_a_joint_and_its_speed() -> None:
    way = step(0.5, 1.0)
    path = np.stack([way, 0 * way, 0 * way], axis=1)
    event, *others = speed_events({"right_wrist": path, "head": 0.1 * path}, FPS, {})
    assert others == []
    assert (event.kind, event.name, event.unit) == ("fastest", "right_wrist", "m/s")
    assert event.index / FPS == pytest.approx(0.75, abs=1e-3)
    assert event.value == pytest.approx(3.2, rel=0.05)
    assert np.isnan([event.sd, event.earliest, event.latest]).all()


def test_a_fastest_moment_is_as_sure_as_the_speed() -> None:
    way = step(0.5, 1.0)
    path = np.stack([way, 0 * way, 0 * way], axis=1)
    sharp, blunt = (
        speed_events({"right_wrist": path}, FPS, {"right_wrist": np.full(len(way), sd)})[0]
        for sd in (0.1, 0.5)
    )
    assert (sharp.sd, blunt.sd) == (0.1, 0.5)
    assert blunt.earliest < sharp.earliest < sharp.index < sharp.latest < blunt.latest
    speed = speeds_m_s(path, FPS)
    first = round(blunt.earliest)
    assert speed[first - 1] < blunt.value - 0.5 <= speed[first]


def test_a_speed_errs_by_what_the_place_errs_along_the_path() -> None:
    path = np.stack([2.0 * TIME, 0 * TIME, 0 * TIME], axis=1)
    along, across = (np.tile(np.diag(v), (len(TIME), 1, 1)) for v in ([400.0, 0, 0], [0, 400.0, 0]))
    np.testing.assert_allclose(speed_spreads_m_s(path, across, FPS), SPEED_SD_SHARE * 2.0)
    expected = np.hypot(SPEED_SD_SHARE * 2.0, SPEED_SD_PER_S * 0.02)
    np.testing.assert_allclose(speed_spreads_m_s(path, along, FPS), expected)


def test_speed_is_that_of_the_motion_and_unknown_for_few_frames() -> None:
    path = np.stack([1.5 * TIME, 2.0 * TIME, 0 * TIME], axis=1)
    np.testing.assert_allclose(speeds_m_s(path, FPS), 2.5)
    assert np.isnan(speeds_m_s(path[:4], FPS)).all()


def test_an_angle_turns_between_frames_and_its_moment_is_as_sure_as_the_angle() -> None:
    peak_s, sd = 0.7025, 2.0
    angle = 40 * np.cos(2 * np.pi * (TIME - peak_s))
    events = angle_events({"knee": angle, "still": 0.1 * angle}, {"knee": np.full(120, sd)})
    assert [(e.kind, e.name) for e in sorted(events, key=lambda e: e.index)] == [
        ("smallest", "knee"),
        ("largest", "knee"),
        ("smallest", "knee"),
        ("largest", "knee"),
    ]
    largest = next(e for e in events if e.kind == "largest")
    assert largest.index / FPS == pytest.approx(peak_s, abs=1e-4)
    assert largest.value == pytest.approx(40, abs=0.01)
    assert largest.sd == sd
    reach_s = np.arccos(1 - sd / 40) / (2 * np.pi)
    assert largest.earliest / FPS == pytest.approx(peak_s - reach_s, abs=1 / FPS)
    assert largest.latest / FPS == pytest.approx(peak_s + reach_s, abs=1 / FPS)


def test_an_angle_known_badly_has_fewer_turning_points() -> None:
    angle = 15 * np.sin(2 * np.pi * TIME)
    assert len(angle_events({"knee": angle}, {})) == 4
    assert angle_events({"knee": angle}, {"knee": np.full(120, 20.0)}) == []


def test_events_of_parts_are_counted_from_the_first_frame() -> None:
    angle = 40 * np.cos(2 * np.pi * (TIME - 1.5))
    angle[:30] = np.nan
    largest = next(e for e in angle_events({"knee": angle}, {}) if e.kind == "largest")
    assert largest.index / FPS == pytest.approx(1.5, abs=1e-3)
    assert np.isnan(largest.earliest)
    assert np.isnan(largest.sd)


def test_a_table_has_times_frames_and_empty_cells(tmp_path: Path) -> None:
    angle = 40 * np.cos(2 * np.pi * (TIME - 0.5))
    events = [e for e in angle_events({"knee": angle}, {}) if e.kind == "largest"]
    frames, phase = np.arange(120) + 30.0, np.full(120, np.nan)
    write_events_csv(tmp_path / "a.csv", events[:1], 0.5 + TIME, frames, phase)
    with (tmp_path / "a.csv").open(newline="") as stream:
        (row,) = csv.DictReader(stream)
    assert row == {
        "time_s": "1.0000",
        "earliest_s": "",
        "latest_s": "",
        "frame": "60.00",
        "phase_s": "",
        "kind": "largest",
        "name": "knee",
        "value": "40.00",
        "unit": "deg",
        "value_sd": "",
    }
