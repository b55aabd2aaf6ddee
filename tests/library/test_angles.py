"""`imocap angles`: the files, and that they belong to the run."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import imocap
from imocap_core.biomechanics.joint_angles import angle_names
from imocap_core.cli import main
from tests.library.conftest import SmallRun


def rows(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_tables_of_every_video_and_their_mean(small_run: SmallRun, tmp_path: Path) -> None:
    written = imocap.angles("serve", tmp_path, root=small_run.root)
    names = [file.name for file in written.files]
    assert names == [
        *("v1_angles.csv", "v1_events.csv", "v2_angles.csv", "v2_events.csv"),
        *("mean_angles.csv", "mean_events.csv", "angles.png", "export_angles.json"),
    ]
    table = rows(tmp_path / "v1_angles.csv")
    assert len(table) == len(small_run.result["v1"])
    assert {f"{name}_deg" for name in angle_names()} < set(table[0])
    assert all(-180 <= float(row["left_knee_flexion_deg"]) <= 180 for row in table)
    assert all(float(row["left_knee_flexion_sd_deg"]) > 0 for row in table)
    mean = rows(tmp_path / "mean_angles.csv")
    assert max(int(row["performances"]) for row in mean) == 2
    assert json.loads((tmp_path / "export_angles.json").read_text())["run"]["seed"] == 7


def test_events_are_those_of_the_result(small_run: SmallRun, tmp_path: Path) -> None:
    imocap.angles("serve", tmp_path, root=small_run.root)
    for video, events in small_run.result.events().items():
        table = rows(tmp_path / f"{video}_events.csv")
        assert [(row["kind"], row["name"]) for row in table] == [(e.kind, e.name) for e in events]
        times = [float(row["time_s"]) for row in table]
        assert times == sorted(times)
        assert all(0 <= e.index <= len(small_run.result[video]) - 1 for e in events)


def test_the_command_replaces_its_files_and_no_others(
    small_run: SmallRun, tmp_path: Path, monkeypatch
) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr("sys.argv", ["imocap"])
    words = ["angles", "serve", "--out", str(tmp_path), "--root", str(small_run.root)]
    assert main(words) == main(words) == 0
    (tmp_path / "v1_angles.csv").write_text("mine")
    assert main(words) == 1
    assert (tmp_path / "v1_angles.csv").read_text() == "mine"
