"""Tables: rounded for people, exact for programs, and nothing unscored passed off as zero."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from imocap_core.adapters.lenses import lens_words, lenses_of
from imocap_core.adapters.sync_maps import maps_of
from imocap_core.artifacts.schemas import (
    CameraMotion,
    CycleTriple,
    GroundPlane,
    LensDistortion,
    NearPair,
    Redetect,
    RedetectedVideo,
    SyncTrust,
    Uncertainty,
    VideoKeypoints,
    VideoTrust,
    Viewpoint,
    WeakSpan,
)
from imocap_core.diagnostics.detection_findings import camera_findings, remarks
from imocap_core.evaluate.action_scores import CALIBRATION_METRICS, normalised_rows
from imocap_core.evaluate.scoreboard import StageResult, against_truth, cycle_row
from imocap_core.io.truth import read_truth
from imocap_core.metrics.scoring import ScoreRow, over_videos
from imocap_core.report.page import html_table
from imocap_core.report.table_files import GLOSSARY, cell_text, column_title, csv_text, json_text
from imocap_core.report.tables import (
    ground_tables,
    long_table,
    metric_tables,
    second_look_tables,
    video_table,
)
from imocap_core.report.uncertainty_tables import (
    SHOWN,
    observability_table,
    sentences,
    trust_tables,
    uncertainty_tables,
    write_observability,
)
from tests.made_sync import stored_matrix
from tests.report.made import SIZE, K, Made

ROWS = [
    ScoreRow("monocular", "v1", "mpjpe_mm", 10.04),
    ScoreRow("monocular", "v2", "mpjpe_mm", 30.0),
    ScoreRow("after loop", "v1", "mpjpe_mm", 5.0),
    ScoreRow("after loop", "v2", "mpjpe_mm", 7.0),
    ScoreRow("after loop", "v2", "sync_error_pct", None, "no <truth>"),
]


def test_tables_hold_the_means_and_name_what_is_missing() -> None:
    tables = {t.name: t for t in metric_tables(ROWS, over_videos(ROWS))}
    assert tables["summary"].columns == ["result", "mpjpe_mm"]
    assert tables["summary"].rows == [["monocular", 20.02], ["after loop", 6.0]]
    assert tables["pose"].rows[-1] == ["all videos", "after loop", 6.0]
    assert tables["unscored"].rows == [["sync_error_pct", "no <truth>"]]
    assert "sync" not in tables  # nothing in it


def test_cells_are_rounded_by_their_unit() -> None:
    assert cell_text("mpjpe_mm", 20.04) == "20.0"
    assert cell_text("sync_error_pct", 0.456) == "0.46"
    assert cell_text("mpjpe_mm", None) == "–"
    assert cell_text("frames", 12) == "12"


def test_columns_are_headed_by_words_and_units() -> None:
    assert column_title("pa_mpjpe_mm") == "joint error, aligned (mm)"
    assert column_title("foot_sliding_mm_s") == "foot sliding (mm/s)"
    assert column_title("video") == "video"
    titles = [column_title(name) for name in GLOSSARY]
    assert len(set(titles)) == len(titles)
    assert [t for t in titles if "_" in t or "mpj" in t] == []
    assert "joint error (mm)" in html_table(metric_tables(ROWS, over_videos(ROWS))[0])


def test_html_escapes_what_others_wrote() -> None:
    assert "no &lt;truth&gt;" in html_table(long_table(ROWS))


def test_csv_and_json_keep_every_digit_and_leave_the_unscored_empty() -> None:
    table = long_table(ROWS)
    lines = list(csv.DictReader(csv_text(table).splitlines()))
    assert float(lines[0]["value"]) == 10.04
    assert lines[-1]["value"] == ""
    records = json.loads(json_text([table]))["metrics"]
    assert records[-1]["value"] is None
    assert records[0] == {
        "result": "monocular", "video": "v1", "metric": "mpjpe_mm", "value": 10.04, "note": "",
    }  # fmt: skip


def test_without_a_ground_there_is_no_table() -> None:
    made = Made()
    assert ground_tables(made.initial, made.camera_motion, made.refined) == []


def test_cameras_above_a_ground() -> None:
    made = Made()
    pitch = np.radians(10.0)
    up = np.array([0.0, -np.cos(pitch), -np.sin(pitch)])
    sole = made.refined.motion.videos[0].joints[:, [10, 11]] @ up
    origin = (sole.min() + 0.013) * up  # balls of the feet 27 mm above soles, 40 mm below
    plane = GroundPlane(up=up, origin=origin, tilt_sd_deg=2.0, height_sd_mm=12.0)
    motion = made.refined.motion.model_copy(update={"ground": plane})
    refined = made.refined.model_copy(update={"motion": motion})
    initial = made.initial.model_copy(update={"grounds": [plane] * 3})
    (table,) = ground_tables(initial, made.camera_motion, refined)
    row = dict(zip(table.columns, table.rows[0], strict=True))
    assert row["pitch_down_deg"] == pytest.approx(10.0)
    assert row["roll_deg"] == pytest.approx(0.0)
    assert row["camera_height_m"] == pytest.approx(-origin @ up)
    assert 0 < row["sole_depth_mm"] <= 40.0 + 1e-6
    assert row["up_alone_deg"] == pytest.approx(0.0, abs=1e-5)
    assert "2.0 degrees" in table.note


def with_lens(made: Made) -> CameraMotion:
    lens = LensDistortion(source="rotation", coefficients=np.array([-0.2, 0, 0, 0, 0]), k1_sd=0.01)
    first, *others = made.camera_motion.videos
    note = f"turns by up to 9.0 degrees; {lens_words(lens, SIZE, K)}"
    bent = first.model_copy(update={"lens": lens, "note": note})
    return CameraMotion(videos=[bent, *others])


def test_the_table_of_videos(made: Made) -> None:
    cameras = with_lens(made)
    table = video_table(made.keypoints, cameras, made.refined)
    column = table.columns.index("lens_k1")
    assert [row[column] for row in table.rows] == [-0.2, *[None] * (len(table.rows) - 1)]
    plain = video_table(made.keypoints, made.camera_motion, made.refined)
    assert "lens_k1" not in plain.columns
    assert {len(row) for row in plain.rows} == {len(plain.columns)}


def test_the_remark(made: Made) -> None:
    (remark,) = camera_findings(with_lens(made).videos)
    assert (remark.kind, remark.video) == ("remark", made.camera_motion.videos[0].id)
    assert remark.text.startswith(
        "its lens was estimated from its turning and is corrected (k1 -0.200 +- 0.010, "
    )
    assert camera_findings(made.camera_motion.videos) == []


def test_lenses_by_video(made: Made) -> None:
    lenses = lenses_of(with_lens(made), None)
    assert list(lenses) == [made.camera_motion.videos[0].id]
    assert next(iter(lenses.values())).coefficients[0] == pytest.approx(-0.2)
    assert lenses_of(made.camera_motion, None) == {}


def test_each_video_says_what_was_asked_and_what_moved() -> None:
    video = RedetectedVideo(
        id="v2", looked_at=np.array([3, 4, 9]), contradicted=5, frame=np.array([3, 3, 9]),
        point=np.array([15, 17, 27]), xy_px=np.zeros((3, 2)), xy_first_px=np.zeros((3, 2)),
        confidence=np.array([0.5, 0.0, 0.7]),
    )  # fmt: skip
    (table,) = second_look_tables(Redetect(videos=[video], note=""))
    assert table.rows == [["v2", 3, 5, 2]]
    titles = [column_title(name) for name in table.columns]
    assert titles == ["video", "pictures looked at again", "joints contradicted", "joints moved"]
    assert set(table.columns[1:]) <= set(GLOSSARY)
    assert second_look_tables(Redetect(videos=[], note="nothing to look at")) == []


FOLLOWED = "2 people followed; the performer is seen in 9 of 9 frames and scores 3.0 times the next"


@pytest.mark.parametrize(
    ("note", "expected"),
    [
        ("", []),
        ("; the picture is shown in a mirror", ["the picture is shown in a mirror"]),
        (
            "; track 2 was taken, not track 1: so; left and right of a limb put back in 3 frames",
            ["track 2 was taken, not track 1: so", "left and right of a limb put back in 3 frames"],
        ),
    ],
)
def test_remarks(note: str, expected: list[str]) -> None:
    assert remarks(VideoKeypoints.model_construct(note=FOLLOWED + note)) == expected


def trust_of(made: Made) -> SyncTrust:
    nan = float("nan")
    return SyncTrust(
        videos=[
            VideoTrust(
                id=i, phase_s=np.arange(len(f)) / 30.0, outlier_score=1.0 + v / 8,
                mirror_margin=nan, left_out_frames=nan, left_out_s=nan, left_out_share=nan,
            )
            for v, (i, f) in enumerate(zip(made.ids, made.frames, strict=True))
        ],
        triples=[CycleTriple(videos=made.ids, frames=0.75, seconds=0.025, share=0.9)],
    )  # fmt: skip


def test_what_is_known_is_shown_and_the_rest_is_a_dash(made: Made) -> None:
    note = "v3 seems to show another action"
    sync = made.sync.model_copy(
        update={"trust": trust_of(made), "excluded": ["v3"], "notes": [note]}
    )
    videos, cycles = trust_tables(sync)
    assert videos.rows[2][:4] == ["v3", "excluded", 1.25, None]
    assert videos.note == "v3 seems to show another action."
    assert cycles.rows == [["v1 v2 v3", 0.75, 0.025, 0.9]]
    row = '<td>v3</td><td>excluded</td><td class="n">1.250</td><td>–</td>'
    assert row in html_table(videos)
    assert trust_tables(made.sync) == []


def test_a_video_without_part_is_not_scored_against_the_others(made: Made, tmp_path: Path) -> None:
    made.write_truth(tmp_path / "truth.npz")
    frames = dict(zip(made.ids, made.frames, strict=True))
    truth = read_truth(tmp_path / "truth.npz", frames)
    whole = made.sync
    lost = whole.maps[2].model_copy(
        update={"reference_frame": whole.maps[2].reference_frame * np.nan}
    )
    out = whole.model_copy(update={"excluded": ["v3"], "maps": [*whole.maps[:2], lost]})
    cameras = made.single.cameras
    broken = [*cameras[:2], cameras[2].model_copy(update={"R": np.eye(3)})]
    plain, without = (
        against_truth(StageResult("x", made.final, c, s), made.keypoints, truth)
        for c, s in ((broken, whole), (broken, out))
    )
    assert plain["camera_rotation_error_deg"] > 20.0
    assert without["camera_rotation_error_deg"] < 1.0
    assert without["matched_share"] > 0.8


def test_the_cycle_residual_speaks_of_the_videos_that_take_part(made: Made) -> None:
    n = sum(made.sync.lengths[:2])
    relaxed = maps_of(made.sync).dense()
    relaxed[n:, :n] = relaxed[:n, n:] = 0.0
    stored = stored_matrix(relaxed, made.sync.ids, made.sync.lengths)
    whole = made.sync.model_copy(update=stored)
    out = whole.model_copy(update={"excluded": ["v3"]})
    assert (cycle_row("x", whole).value or 0) > 3.0
    assert cycle_row("x", out).value == 0.0


def changed(made: Made, **values: object) -> Uncertainty:
    return made.claimed.model_copy(update=values)


def span(video: str, sigma_mm: float) -> WeakSpan:
    return WeakSpan(
        video=video, joint="left_wrist", first_frame=36, last_frame=57, begin_s=1.2, end_s=1.9,
        sigma_mm=sigma_mm, of_median=sigma_mm / 20,
    )  # fmt: skip


def test_a_joint_is_named_with_its_time(made: Made) -> None:
    lines = sentences(changed(made, weak=[span("v2", 85.0)]), made.refined.sync)
    assert (
        "v2: left wrist from 1.2 to 1.9 s (frames 36 to 57): 85 mm, 4.2 times the action's median."
        in lines
    )
    assert not any("No joint" in line for line in lines)


@pytest.mark.parametrize(("across", "constraint"), [(False, "priors"), (True, "the other videos")])
def test_near_identical_views_are_called_by_name(made: Made, across: bool, constraint: str) -> None:
    pair = NearPair(videos=["v2", "v3"], angle_deg=8.2, seen_across=across)
    assert sentences(changed(made, near=[pair]), made.refined.sync)[0] == (
        "v2 and v3 show the performer from nearly the same side (8 degrees apart): depth along "
        f"their line of sight depends on {constraint}."
    )


def test_a_missing_side_is_suggested_where_one_stands_out(made: Made) -> None:
    views = [Viewpoint(azimuth_deg=a, reduction=r) for a, r in ((0, 0.1), (90, 0.51), (180, 0.2))]
    line = sentences(changed(made, viewpoints=views), made.refined.sync)[0]
    assert line == (
        "One more video would help most from the performer's left: expected errors about 30% "
        "smaller."
    )
    left_out = made.refined.sync.model_copy(update={"excluded": ["v3"]})
    line = sentences(changed(made, viewpoints=views[:1]), left_out)[0]
    assert line.startswith("No side is suggested for one more camera: v3 may show what is missing")


def test_the_page_names_the_worst_and_the_file_all(made: Made, tmp_path: Path) -> None:
    weak = [span("v1", 100.0 - k) for k in range(SHOWN + 3)]
    claimed = changed(made, weak=weak)
    assert sum("left wrist" in s for s in sentences(claimed, made.refined.sync)) == SHOWN
    assert "observability.md lists 3 more spans." in sentences(claimed, made.refined.sync)
    name = write_observability(tmp_path, "yoga", claimed, made.refined.sync)
    page = (tmp_path / name).read_text(encoding="utf-8")
    assert page.count("left wrist") == SHOWN + 3
    assert page.startswith("# yoga: observability")
    table = observability_table(claimed, made.refined.sync)
    assert [row[0] for row in table.rows] == sentences(claimed, made.refined.sync)


def test_without_truth_claims_stand_alone(made: Made) -> None:
    motions = made.refined.motion.videos
    rows = normalised_rows("after loop", made.claimed, motions, None)
    assert {row.metric for row in rows} == set(CALIBRATION_METRICS)
    assert all(row.value is None and row.note == "no truth" for row in rows)
    tables = uncertainty_tables(made.claimed, motions, None, [*rows, *over_videos(rows)])
    by_video = tables[0]
    assert by_video.rows[-1][by_video.columns.index("sigma_mm")] == pytest.approx(20)
    assert by_video.rows[0][by_video.columns.index("normalised_error")] is None
    assert tables[1].rows[0][2:] == [None, None]
