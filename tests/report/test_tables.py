"""Tables: rounded for people, exact for programs, and nothing unscored passed off as zero."""

from __future__ import annotations

import csv
import json

from imocap_core.metrics.scoring import ScoreRow, over_videos
from imocap_core.report.page import html_table, markdown
from imocap_core.report.table_files import GLOSSARY, cell_text, column_title, csv_text, json_text
from imocap_core.report.tables import long_table, metric_tables

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
    assert "joint error (mm)" in markdown(metric_tables(ROWS, over_videos(ROWS))[0])


def test_markdown_aligns_numbers_and_escapes_bars() -> None:
    table = long_table([ScoreRow("a|b", "v1", "mpjpe_mm", 1.0)])
    lines = markdown(table).splitlines()
    assert lines[3] == "| --- | --- | --- | ---: | --- |"
    assert lines[4].startswith("| a\\|b | v1 | mpjpe_mm | 1.000 |")


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
