"""TRC and CSV files of joints, read back as their users read them."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

from imocap_core.io.writers.text_files import trc_text, write_joints_csv, write_trc
from tests.io.made_clips import made_clip


def test_trc_comes_back(tmp_path: Path) -> None:
    clip = made_clip(fps=29.97).clip
    write_trc(tmp_path / "v1.trc", clip)
    lines = (tmp_path / "v1.trc").read_text().split("\n")
    assert lines[0] == "PathFileType\t4\t(X/Y/Z)\tv1.trc"
    about = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    assert about["Units"] == "mm"
    assert about["DataRate"] == about["CameraRate"] == about["OrigDataRate"] == "29.97"
    assert (about["NumFrames"], about["NumMarkers"]) == ("12", "24")
    assert (about["OrigDataStartFrame"], about["OrigNumFrames"]) == ("7", "12")
    names = lines[3].split("\t")
    assert names[:2] == ["Frame#", "Time"]
    assert names[2::3][:24] == list(clip.joint_names)
    assert lines[4].split("\t")[2:8] == ["X1", "Y1", "Z1", "X2", "Y2", "Z2"]
    assert lines[5] == ""
    rows = np.array([[float(x) for x in line.split("\t")] for line in lines[6:-1]])
    np.testing.assert_array_equal(rows[:, 0], np.arange(1, 13))
    np.testing.assert_allclose(rows[:, 1], np.arange(12) / 29.97, atol=1e-6)
    np.testing.assert_allclose(rows[:, 2:].reshape(12, 24, 3), 1000 * clip.joints, atol=6e-4)


def test_trc_names_the_nearest_first_frame() -> None:
    clip = made_clip().clip
    lines = trc_text(replace(clip, frames=clip.frames + 0.4), "x.trc").split("\n")
    assert lines[2].split("\t")[6] == "7"


def test_csv_comes_back(tmp_path: Path) -> None:
    clip = made_clip(hands=True).clip
    phase = clip.phase_s.copy()
    phase[3] = np.nan
    inside = clip.inside.copy()
    inside[-1] = False
    frames = clip.frames + 0.25
    sd = {"left_wrist": np.where(np.arange(len(phase)) == 2, np.nan, 12.5)}
    written = replace(clip, phase_s=phase, inside=inside, frames=frames)
    write_joints_csv(tmp_path / "v1.csv", written, sd)
    with (tmp_path / "v1.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["inside"] for row in rows] == ["1"] * 11 + ["0"]
    assert rows[3]["phase_s"] == ""
    assert [row["left_wrist_sd_m"] for row in rows[1:4]] == ["0.012500", "", "0.012500"]
    assert "right_wrist_sd_m" not in rows[0]
    assert rows[0]["frame"] == "7.25"
    for j, name in enumerate(clip.joint_names):
        ours = [[float(row[f"{name}_{axis}_m"]) for axis in "xyz"] for row in rows]
        np.testing.assert_allclose(ours, clip.joints[:, j], atol=6e-7)
