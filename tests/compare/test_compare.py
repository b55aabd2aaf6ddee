"""imocap compare: files, numbers and sentences, of one action and of two; what chance explains."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.artifacts.schemas import Keypoints, RefineSync
from imocap_core.compare import compare
from imocap_core.compare.compare import describe, pair_angles, pair_on_one_axis, performances_of
from imocap_core.compare.parts import LIKELY, Chance, chance_of, pair_findings
from imocap_core.compare.technique_report import write_pair, write_technique
from imocap_core.errors import WorkFailed
from imocap_core.library.result import Result
from imocap_core.params import SyncParams
from imocap_core.technique import largest
from tests.pipeline.made_result import PHASES, Made, keypoints, made_result, refined


@pytest.fixture
def made(tmp_path: Path) -> Made:
    return made_result(tmp_path)


def swung(found: RefineSync, degrees: float) -> RefineSync:
    """The same with the left shoulder of video `b` turned by some degrees more throughout."""
    videos = []
    for v in found.motion.videos:
        theta = v.theta.copy()
        if v.id == "b":
            theta[:, 3 * 16 + 2] += np.deg2rad(degrees)
        videos.append(v.model_copy(update={"theta": theta}))
    motion = found.motion.model_copy(update={"videos": videos})
    return found.model_copy(update={"motion": motion})


def of_two_performers(made: Made, degrees: float) -> Result:
    """Ann performs in `a`; Bo, in `b`, lifts the left arm by some degrees more."""
    both = [
        keypoints(video).model_copy(update={"performer": name})
        for video, name in (("a", "Ann"), ("b", "Bo"))
    ]
    made.publish("keypoints", Keypoints(videos=both))
    made.publish("refine_sync", swung(refined(PHASES), degrees))
    return made.result()


def page_of(file: Path) -> dict[str, Any]:
    """The header of a page: what it shows, without its arrays."""
    (text,) = re.findall(r'id="header">(.*?)</script>', file.read_text(), re.DOTALL)
    header: dict[str, Any] = json.loads(text)
    return header


def test_a_performer_who_lifts_the_arm_more(made: Made) -> None:
    made.publish("refine_sync", swung(refined(PHASES), 10.0))
    found = compare.describe(compare.performances_of(made.result()))
    rms = np.sqrt(np.nanmean(found.spread_deg**2, axis=0))
    by_joint = dict(zip(found.instances.joint_names, rms, strict=True))
    assert by_joint["left_shoulder"] == pytest.approx(10 / np.sqrt(2), abs=0.2)
    assert max(d for name, d in by_joint.items() if name != "left_shoulder") < 0.5
    assert found.modes.share == pytest.approx([1.0])
    apart = abs(found.modes.scores[0, 0] - found.modes.scores[1, 0])
    assert apart * found.modes.of_joints()[0, 16] == pytest.approx(10, abs=0.3)


def test_what_is_written(made: Made) -> None:
    made.publish("refine_sync", swung(refined(PHASES), 20.0))
    found = compare.describe(compare.performances_of(made.result()))
    files = write_technique(made.out, found)
    assert [f.name for f in files] == [*("report.html", "joints.csv", "performances.csv")]
    assert all(f.stat().st_size > 50 for f in files)
    page = page_of(files[0])
    assert page["lead"].startswith("a and b at the same moments")
    assert any(note.startswith("Consistency 0.") for note in page["notes"])
    assert any("2 performances differ in ways" in note for note in page["notes"])
    with files[1].open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 28 * 22
    shoulder = [float(r["spread_deg"]) for r in rows if r["joint"] == "left_shoulder"]
    np.testing.assert_allclose(shoulder, 20 / np.sqrt(2), atol=0.3)
    (text,) = (f["text"] for f in page["findings"] if f["text"].startswith("left arm raised: b "))
    assert "(raised 20° higher), at " in text  # against a: nobody performed their mean


def test_two_actions_on_one_axis(made: Made, tmp_path: Path) -> None:
    """The second one's performances: the same swing, the arm 10 degrees higher."""
    other = made_result(tmp_path / "other")
    lifted = swung(swung(refined(PHASES), 10.0), 0.0)
    videos = [v for v in lifted.motion.videos if v.id == "b"]
    videos.insert(0, refined(PHASES).motion.videos[0])
    theta = videos[0].theta.copy()
    theta[:, 3 * 16 + 2] += np.deg2rad(10.0)
    videos[0] = videos[0].model_copy(update={"theta": theta})
    motion = lifted.motion.model_copy(update={"videos": videos})
    other.publish("refine_sync", lifted.model_copy(update={"motion": motion}))
    first = compare.performances_of(made.result())
    second = compare.performances_of(other.result(), first.shaped)
    pair = compare.pair_of(
        compare.describe(first), compare.describe(second), SyncParams(), np.random.default_rng(0)
    )
    assert len(pair.phase_s) > 10
    angle = np.median(pair.difference.angle_deg, axis=0)
    assert angle[16] == pytest.approx(10.0, abs=1.5)
    assert np.abs(pair.second_s - pair.phase_s).mean() < 0.15
    files = write_pair(made.out, pair)
    assert page_of(files[0])["title"] == "walk (1) and walk (2)"
    assert all(f.stat().st_size > 100 for f in files)
    angles = compare.pair_angles(pair)
    chance = chance_of(angles[0].each, angles[1].each, np.random.default_rng(0))
    found = pair_findings(pair, angles, chance)[0]
    assert found.angle == "left_shoulder_elevation"
    assert "2 and 2 performances are too few" in page_of(files[0])["notes"][0]
    assert re.match(
        r"left arm raised: walk \(2\) −?\d+°, walk \(1\) −?\d+° \(raised \d+° higher\), at ",
        found.sentence,
    )


def test_two_performers_of_one_action(made: Made) -> None:
    result = of_two_performers(made, 10.0)
    assert result["a"].performer == "Ann"
    assert compare.performers_of(result) == ["Ann", "Bo"]
    first, second = (
        compare.describe(compare.performances_of(result, performer=p)) for p in ("Ann", "Bo")
    )
    assert first.instances.ids == ("a",)
    pair = compare.pair_on_one_axis(first, second)
    angle = np.median(pair.difference.angle_deg, axis=0)
    assert angle[16] == pytest.approx(10.0, abs=0.5)
    assert np.delete(angle, 16).max() < 0.5
    np.testing.assert_allclose(pair.second_s, pair.phase_s, atol=1e-9)
    assert page_of(write_pair(made.out, pair)[0])["title"] == "Ann and Bo"


def test_performers_that_share_no_moment(made: Made) -> None:
    first = compare.describe(compare.performances_of(made.result()))
    later = replace(first.instances, phase_s=first.instances.phase_s + 100.0)
    second = replace(first, performances=replace(first.performances, instances=later))
    with pytest.raises(WorkFailed, match="share 0 moments of the action"):
        compare.pair_on_one_axis(first, second)


def test_differences_in_words() -> None:
    """Large first; those below the repetitions' standard deviation last; small ones not at all."""
    phase_s = np.arange(4) / 2.0
    bump = np.array([0.0, 0.0, 1.0, 0.0])
    flat = np.full(4, -0.04)  # rounded: 0°, not −0°
    names = ("left_knee_flexion", "trunk_flexion", "right_elbow_flexion", "pelvis_tilt")
    angles = dict(zip(names, (40 * bump, -12.4 * bump, 50 * bump, 4.9 * bump), strict=True))
    spread = {"left_knee_flexion": flat + 10, "right_elbow_flexion": flat + 60}
    found = largest("Bo", "Ann", phase_s, angles, dict.fromkeys(names, flat), spread)
    assert [f.sentence for f in found] == [
        "left knee bend: Bo 40°, Ann 0° (40° more bent), at 1.00 s, 4.0 standard deviations",
        "trunk bent forward: Bo −12°, Ann 0° (bent 12° further back), at 1.00 s",
        "right elbow bend: Bo 50°, Ann 0° (50° more bent), at 1.00 s, "
        "within the spread of their repetitions",
    ]
    assert [f.phase_s for f in found] == [1.0] * 3


def test_which_moments_are_compared() -> None:
    inside = np.ones((3, 10), dtype=bool)
    inside[0, :2] = False
    np.testing.assert_array_equal(compare.compared_moments(inside), inside[0])
    inside[0, :8] = False  # a short one does not cut the others down
    np.testing.assert_array_equal(compare.compared_moments(inside), np.ones(10, dtype=bool))


def test_one_performance_has_no_spread(made: Made) -> None:
    alone = {"a": PHASES["a"], "b": np.full(21, np.nan)}
    made.publish("refine_sync", refined(alone))
    found = compare.performances_of(made.result())
    assert found.left_out == ("b: no place on the common axis",)
    with pytest.raises(WorkFailed, match="walk has one performance, and its spread needs two"):
        compare.several(found)
    lonely = compare.describe(found)
    assert np.isnan(lonely.spread_mm).all()
    assert np.isnan(lonely.consistency)


N, ANGLES = 40, ("knee", "elbow", "hip")


def performances(count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Smooth curves of one kind: a mean, and deviations of 6 degrees that last."""
    t = np.linspace(0, np.pi, N)
    waves = np.stack([np.ones(N), np.cos(t), np.sin(t)])
    return {a: 60 * np.sin(t) + rng.normal(0, 6, (count, 3)) @ waves for a in ANGLES}


def test_sets_of_one_kind_differ_by_more_than_chance_in_one_of_twenty() -> None:
    rng = np.random.default_rng(0)
    least = [
        min(chance_of(performances(5, rng), performances(5, rng), rng).p.values())
        for _ in range(200)
    ]
    assert 0.01 <= np.mean(np.array(least) <= LIKELY) <= 0.08


def test_an_angle_that_differs_is_found_and_the_others_are_not() -> None:
    rng = np.random.default_rng(1)
    first, second = performances(6, rng), performances(6, rng)
    second["elbow"] = second["elbow"] + 25
    chance = chance_of(first, second, rng)
    assert chance.p["elbow"] <= 0.01
    assert min(chance.p["knee"], chance.p["hip"]) > LIKELY


def test_the_probability_does_not_depend_on_which_set_is_first_nor_on_unseen_moments() -> None:
    rng = np.random.default_rng(2)
    first, second = performances(4, rng), performances(5, rng)
    there, back = chance_of(first, second, rng), chance_of(second, first, rng)
    assert there.p == pytest.approx(back.p)
    cut = {a: np.where(np.arange(N) < N - 5, x, np.nan) for a, x in first.items()}
    shorter = [{a: x[:, : N - 5] for a, x in of.items()} for of in (first, second)]
    assert chance_of(cut, second, rng).p == pytest.approx(chance_of(*shorter, rng).p)


@pytest.mark.parametrize(("ours", "theirs", "least"), [(4, 4, 2 / 70), (3, 4, 1 / 35), (3, 3, 0.1)])
def test_the_least_probability_is_that_of_one_division(ours, theirs, least):
    rng = np.random.default_rng(3)
    chance = chance_of(performances(ours, rng), performances(theirs, rng), rng)
    assert chance.least == pytest.approx(least)
    assert min(chance.p.values()) >= least - 1e-12
    assert chance.telling == (least <= LIKELY)


def test_one_against_one_tells_nothing() -> None:
    rng = np.random.default_rng(4)
    chance = chance_of(performances(1, rng), performances(1, rng), rng)
    assert set(chance.p.values()) == {1.0}
    assert not chance.telling


def test_a_difference_that_chance_or_the_expected_error_explains_says_so(tmp_path: Path) -> None:
    first = describe(performances_of(made_result(tmp_path).result()))
    pair = pair_on_one_axis(first, first)
    angles = pair_angles(pair)
    moved = {n: replace(c, mean_deg=c.mean_deg + 20) for n, c in angles[1].mean.items()}
    angles = angles[0], replace(angles[1], mean=moved)

    def sentences(p: float, error: float) -> set[str]:
        errors = {n: np.full((2, len(first.instances.phase_s)), error) for n in moved}
        told = replace(first, performances=replace(first.performances, error_deg=errors))
        found = replace(pair, first=told, second=told)
        chance = Chance(dict.fromkeys(moved, p), 0.01)
        return {f.sentence.rpartition(" s, ")[2] for f in pair_findings(found, angles, chance)}

    assert sentences(0.3, 1.0) == {"which chance explains (p = 0.30)"}
    assert sentences(0.02, 8.0) == {"within twice the expected error (± 11°)"}
    assert sentences(0.02, 1.0) == {"more than chance explains (p = 0.02)"}
