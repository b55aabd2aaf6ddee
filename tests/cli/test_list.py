"""`imocap list`: the actions of a working folder, their state, their results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from imocap_core.library.status import headline_of

if TYPE_CHECKING:
    from tests.pipeline.conftest import Toy

Capture = pytest.CaptureFixture[str]


def listed(toy: Toy, capsys: Capture) -> dict[str, dict]:
    capsys.readouterr()
    assert toy.imocap(["list", "--json"]) == 0
    return {row["name"]: row for row in json.loads(capsys.readouterr().out)["actions"]}


def test_the_state_of_an_action_follows_its_runs(toy: Toy, capsys: Capture) -> None:
    assert listed(toy, capsys)["toy"]["state"] == "not run"
    toy.imocap(["run", "toy"])
    row = listed(toy, capsys)["toy"]
    assert (row["state"], row["videos"], row["stages"], row["cached"]) == ("cached", 2, 3, 3)
    (toy.action / "v1.txt").write_text("9")
    row = listed(toy, capsys)["toy"]
    assert (row["state"], row["cached"]) == ("partly cached", 0)


def test_built_in_and_invalid_actions_are_listed_too(toy: Toy, capsys: Capture) -> None:
    broken = toy.root / "actions" / "broken"
    broken.mkdir()
    (broken / "action.yaml").write_text("name: broken\nvideos: 3\n")
    rows = listed(toy, capsys)
    assert list(rows) == ["broken", "taichi", "toy", "yoga"]
    assert rows["yoga"]["state"] == "not made"
    assert rows["broken"]["state"] == "invalid"
    assert "videos" in rows["broken"]["fault"]


def test_the_table_has_a_line_for_each_action(toy: Toy, capsys: Capture) -> None:
    toy.imocap(["run", "toy"])
    report = toy.root / "artifacts" / "toy" / "report"
    (report / "summary.csv").write_text("result,reprojection_px\nafter loop,8.7\n")
    capsys.readouterr()
    assert toy.imocap(["list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (row,) = (line.split() for line in lines if line.startswith("toy"))
    assert row == ["toy", "2", "cached", "reprojection", "8.7", "px"]
    assert "built in, not made yet" in "\n".join(lines)


def test_the_headline_is_of_the_last_result_and_of_what_was_scored(tmp_path: Path) -> None:
    file = tmp_path / "summary.csv"
    assert headline_of(file) == ""
    file.write_text("result,mpjpe_scaled_mm,sync_error_pct,reprojection_px\n")
    assert headline_of(file) == ""
    file.write_text(
        "result,mpjpe_scaled_mm,sync_error_pct,matched_share,reprojection_px\n"
        "monocular,90,,,7\nafter loop,45.36,0.556,1.0,8.72\n"
    )
    assert headline_of(file) == "scaled MPJPE 45.4 mm, sync error 0.56 %, matched 100%"
    file.write_text("result,mpjpe_scaled_mm,matched_share,reprojection_px\nafter loop,,0.9,nan\n")
    assert headline_of(file) == "matched 90%"
