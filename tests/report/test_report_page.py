"""The report's page and the coach's card: everything in its place, every number explained, no other
file needed; made once, and again only when something has changed."""

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from imocap_core.artifacts.schemas import Table
from imocap_core.body import load_free_body
from imocap_core.diagnostics.findings import Finding, Verdict
from imocap_core.errors import WorkFailed
from imocap_core.figures.page_figures import over_time
from imocap_core.figures.sheets import most_different_frames, picks_of, sheet_videos
from imocap_core.metrics.scoring import ScoreRow, over_videos
from imocap_core.pipeline.runner import Job, Outcome
from imocap_core.report.action_report import complete, finish, verdict_of_run
from imocap_core.report.first_page import FirstPage, SureDifference, card_page, largest_differences
from imocap_core.report.page import html_page, sections
from imocap_core.report.page_files import prose, refresh_pages
from imocap_core.report.table_files import GLOSSARY, Contents, Picture, read_contents, write_report
from imocap_core.report.tables import long_table, metric_tables
from tests.pipeline.stored import NAME, stored_job
from tests.report.browser import CHROMIUM, Browser
from tests.report.made import Made

DOCS = Path(__file__).parents[2] / "docs"
PAGES = '<a href="../report/viewer.html">3D viewer</a><a href="#technical">Below</a>'
VERDICT = Verdict(
    ("Three videos are synchronised.", "Do not trust v1 <here>."),
    (Finding("feet", "v1", "the foot slides", "sliding", "", 3, 9),),
)
SOURCES = "Files: v1 is side & front.mp4."
FIRST = FirstPage(
    moment="Where the hips are lowest, at 1.00 s",
    head=("angle", "v1", "v2", "expected error", "whole action"),
    rows=(("right knee bend", "63°", "9°", "± 5°", "2° to 90°"),),
    differences=(
        SureDifference("v2's right knee is 54° straighter", "v2", "right_knee", 1.0, (9, 8), 54, 5),
    ),
    figure=Figure(),
    since="Since the last run: 3 videos (+v3).",
)


def _table(name: str, *columns: str) -> Table:
    return Table(
        name=name, title=f"About {name}", columns=list(columns), rows=[[1.0] * len(columns)]
    )


def _page(tmp_path: Path) -> str:
    for name in ("moments.webp", "warp.png", "overlay_v1.webp", "new.png", "angles.png"):
        (tmp_path / name).write_bytes(name.encode())
    contents = Contents("waving <b>", (Picture("moments.webp", "The same moments."),))
    pictures = [
        *contents.pictures,
        Picture("overlay_v1.webp", "v1 over its frames."),
        Picture("warp.png", "Round and back."),
        Picture("new.png", "Nobody planned this."),
    ]
    tables = [
        _table("summary", "result", "mpjpe_mm"),
        _table("trust", "video", "outlier_score"),
        Table(name="open", title="Open", columns=["sentence"], rows=[["v1 and v2 are near."]]),
        _table("extra", "video", "unheard_of"),
        _table("metrics", "result", "value"),
    ]
    parts = sections(tables, pictures)
    return html_page(tmp_path, contents, VERDICT, parts, PAGES, "abc123", SOURCES, FIRST)


def test_the_page_holds_its_pictures_and_names_no_other_file(tmp_path: Path) -> None:
    page = _page(tmp_path)
    sources = re.findall(r'src="([^"]*)"', page)
    assert len(sources) == 5  # each once, the same moments on the first page
    assert all(source.startswith("data:image/") for source in sources)
    assert re.findall(r'href="(?!#)([^"]*)"', page) == ["../report/viewer.html"]
    assert "waving &lt;b&gt;" in page
    assert "Files: v1 is side &amp; front.mp4." in page
    assert page.index("Since the last run: 3 videos (+v3).") < page.index("The same moments")
    assert "abc123" in page[:400]


def test_links_within_the_page_lead_somewhere(tmp_path: Path) -> None:
    page = _page(tmp_path)
    places = re.findall(r'id="([^"]*)"', page)
    assert len(places) == len(set(places))
    assert set(re.findall(r'href="#([^"]*)"', page)) == set(places)
    assert 'id="outlier_score"' in page
    assert 'id="unheard_of"' not in page


def test_nothing_is_lost_and_the_unplanned_comes_last(tmp_path: Path) -> None:
    page = _page(tmp_path)
    for part in ("About summary", "About trust", "v1 and v2 are near.", "Round and back."):
        assert part in page
    assert page.index("Nobody planned this.") > page.index("Round and back.")
    assert "About metrics" not in page  # for programs
    assert page.index("About extra") > page.index("About trust")
    assert page.index(">Synchronisation</h2>") > page.index(">Summary</h2>")
    folded = re.findall(r"<summary>(.*?)</summary>", page)
    assert folded == ["Technical details", "About trust", "v1 over its frames."]


def test_the_verdict_comes_first(tmp_path: Path) -> None:
    page = _page(tmp_path)
    assert "Do not trust v1 &lt;here&gt;." in page
    technical = page.index("Technical details")
    assert page.index("Three videos are synchronised.") < page.index("right knee bend") < technical
    assert page.index("v1 frames 3-9: the foot slides.") > technical
    assert '<span class="level check">Check</span>' in page


def test_without_truth_nothing_is_summed_up_and_reasons_are_given_once() -> None:
    reasons = Table(
        name="unscored",
        title="Not scored",
        columns=["metric", "reason"],
        rows=[["a_mm", "no truth"], ["b_mm", "no truth"], ["c", "one video"]],
    )
    parts = sections([_table("summary", "result", "reprojection_px"), reasons], [])
    assert [part.title for part in parts] == ["Motion", "Not scored"]
    assert [t.name for t in parts[0].folded_tables] == ["summary"]
    assert parts[1].tables[0].rows == [["no truth", "a (mm); b (mm)"], ["one video", "c"]]


def test_a_single_video_is_not_compared_with_itself() -> None:
    rows = [["v1", "monocular", 1.0], ["v1", "after loop", 1.0], ["all videos", "after loop", 1.0]]
    pose = Table(name="pose", title="", columns=["video", "result", "reprojection_px"], rows=rows)
    (part,) = sections([pose], [], videos=1)
    assert part.tables[0].rows == [["v1", "result", 1.0]]
    assert "together" not in part.lead


def test_every_metric_is_explained_and_documented() -> None:
    metrics = ("mpjpe_mm", "mpjpe_17_scaled_mm", "sync_error_pct", "camera_rotation_error_deg")
    rows = [ScoreRow("after loop", "v1", metric, 1.0) for metric in metrics]
    tables = [*metric_tables(rows, over_videos(rows)), long_table(rows)]
    shown = {c for t in tables if t.name != "metrics" for c in t.columns} & set(metrics)
    assert shown <= GLOSSARY.keys()
    documents = "".join((DOCS / f"{n}.md").read_text() for n in ("metrics", "sync", "uncertainty"))
    for name in ("mpjpe_mm", "normalised_error", "matched_share", "outlier_score", "sync_error_ms"):
        assert name in GLOSSARY
        assert name in documents
    assert all(meaning.endswith(".") and len(meaning) < 200 for meaning in GLOSSARY.values())


def test_contents_come_back_as_written(tmp_path: Path) -> None:
    pictures = [Picture("a.png", "An ä.")]
    files = write_report(tmp_path, "t", [], _table("metrics", "value"), pictures)
    assert read_contents(tmp_path) == Contents("t", tuple(pictures))
    assert set(files) == {"a.png", "contents.json", "metrics.csv", "metrics.json"}


def test_most_different_frames_are_where_results_differ_most(made: Made) -> None:
    last = made.final[0]
    joints = last.joints.copy()
    joints[[3, 12], 7] += 0.4
    first = last.model_copy(update={"joints": joints})
    assert most_different_frames(first, last, 2) == [3, 12]
    assert most_different_frames(first, last, 1)[0] in (3, 12)
    moved = last.model_copy(update={"joints": last.joints + 1.0})  # as a whole: no difference
    assert np.isclose(np.ptp(moved.joints - last.joints), 0)


def test_claims_over_time_are_the_mean_of_the_videos_that_show_the_moment(made: Made) -> None:
    videos = [
        v.model_copy(update={"sigma_mm": np.full_like(v.sigma_mm, size)})
        for v, size in zip(made.claimed.videos, (30.0, 40.0, 50.0), strict=True)
    ]
    claimed = made.claimed.model_copy(update={"videos": videos})
    moments_s, sigma_mm = over_time(claimed, made.keypoints, made.refined.sync)
    assert len(moments_s) == 16
    assert sigma_mm[0] == pytest.approx(np.full(12, 30.0))  # the others begin later
    assert sigma_mm[8] == pytest.approx(np.full(12, np.sqrt((900 + 1600 + 2500) / 3)))


def test_a_column_is_chosen_for_every_video(made: Made) -> None:
    from imocap_core.figures.sheets import SheetVideo

    names = load_free_body().points("body25").names
    videos = [
        SheetVideo(s, c, None, names, a, b, c.K, np.eye(3))
        for s, c, a, b in zip(
            made.keypoints.videos, made.camera_motion.videos, made.bent, made.final, strict=True
        )
    ]
    picks = picks_of(videos)
    assert [v for v, _ in picks] == [0, 0, 1, 1, 2, 2]
    assert all(t_a < t_b for (_, t_a), (_, t_b) in zip(picks[::2], picks[1::2], strict=True))


def test_a_column_without_any_value_is_not_shown() -> None:
    trust = Table(
        name="trust", title="", columns=["video", "score", "share"], rows=[["v1", None, 1.0]] * 2
    )
    (part,) = sections([trust], [])
    assert part.folded_tables[0].columns == ["video", "share"]
    assert part.folded_tables[0].rows == [["v1", 1.0]] * 2


def difference(angle: str, size_deg: float, video: str = "v2") -> SureDifference:
    text = f"{angle}: {video} {size_deg}° more bent, ± 4°"
    return SureDifference(text, video, angle, 0.25, (8, 8), size_deg, 4.0)


def test_the_largest_of_different_angles_come_first_and_others_fill_up() -> None:
    sizes = [("knee", 20.0), ("knee", 30.0), ("elbow", 10.0), ("hip", 5.0)]
    given = [difference(*each) for each in sizes]
    assert [d.size_deg for d in largest_differences(given)] == [30.0, 10.0, 5.0]
    assert [d.size_deg for d in largest_differences(given[:3])] == [30.0, 20.0, 10.0]
    assert largest_differences([]) == []


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")
def test_it_fits_a_phone_and_a_sheet(made: Made, tmp_path: Path) -> None:
    model = load_free_body()
    scene = (made.keypoints, made.camera_motion, made.initial, made.refined)
    videos = sheet_videos(*scene, dict.fromkeys(made.ids), model)
    given = [difference("knee", 30.0), difference("hip", 20.0, "v3"), difference("elbow", 9.0)]
    verdict = Verdict(("Three videos are synchronised.",), ())
    assert card_page("waving", verdict, [], videos, made.refined, model) is None
    page = card_page("waving <b>", verdict, given, videos, made.refined, model)
    assert "<b>" not in page
    assert re.findall(r"<h2>(\d)\. (\w+)", page) == [("1", "knee"), ("2", "hip"), ("3", "elbow")]
    assert page.count("<img ") == 9
    assert len(page) < 500_000
    file = tmp_path / "card.html"
    file.write_text(page, encoding="utf-8")
    with Browser(tmp_path / "profile", 390, 844) as browser:
        browser.open(file)
        assert browser.value("document.documentElement.scrollWidth") == 390
        browser.assert_readable(light="255, 255, 255", dark="23, 28, 33")
        assert browser.sheets() == 1
        assert browser.errors == []


@pytest.fixture(scope="module")
def few() -> Made:
    return Made(frames=12)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without pictures, of which one test alone speaks."""
    monkeypatch.setattr("imocap_core.report.write_page.draw_page_figures", lambda *_: [])


def _outcomes(job: Job, how: str = "cached") -> list[Outcome]:
    stored = {stage: job.store.load(NAME, stage) for stage in job.pipeline.stages}
    return [Outcome(s, how, r, 1.5) for s, r in stored.items() if r is not None]  # type: ignore[arg-type]


def test_the_page_is_made_once_and_again_when_something_changed(few: Made, tmp_path: Path) -> None:
    job = stored_job(tmp_path, few, filmed=("v1",))
    page = finish(job, _outcomes(job, "made"))
    assert page.name == "report.html"
    text = page.read_text()
    for part in ("Summary", "Uncertainty", "mpjpe_mm"):
        assert part in text
    folder = page.parent
    for name in ("results.webp", "uncertainty.png"):
        assert (folder / name).stat().st_size > 500
    first = page.stat().st_mtime_ns
    assert finish(job, _outcomes(job)) == page
    assert page.stat().st_mtime_ns == first
    (folder / "viewer.html").write_text("now there is a viewer")
    finish(job, _outcomes(job))
    assert 'href="../report/viewer.html"' in page.read_text()
    index = folder.parent / "index.html"
    assert 'href="report/viewer.html"' in index.read_text()
    assert f"imocap compare {NAME}" in index.read_text()  # what has not been made says how
    page.write_text("mine")
    refresh_pages(job.store, NAME)
    assert page.read_text() == "mine"


@pytest.mark.usefixtures("undrawn")
def test_the_report_begins_with_the_verdict_of_the_run_and_what_breaks_off_is_made_again(
    few, tmp_path
):
    job = stored_job(tmp_path, few)
    page = finish(job, _outcomes(job))
    whole = page.read_bytes()
    for left in (5000, 0):
        page.write_bytes(whole[:left])  # as a full disk leaves it
        finish(job, _outcomes(job))
        assert page.read_bytes() == whole
    verdict = verdict_of_run(job, _outcomes(job))
    text = page.read_text()
    assert f'<span class="level {verdict.level}">' in text
    assert text.index(prose(verdict.summary[0])) < text.index("Technical details")
    text = page.with_name("verdict.json").read_text()
    for other in ("{broken", text.replace("summary", "summery"), text.replace("v1", "v9")):
        page.with_name("verdict.json").write_text(other)
        assert verdict_of_run(job, _outcomes(job)) == verdict
    page.with_name("verdict.json").unlink()
    finish(job, _outcomes(job))
    assert page.with_name("verdict.json").is_file()


PRIVATE = '{"title": "a", "pictures": [{"file": "../../../private.jpg", "caption": ""}]}'


@pytest.mark.usefixtures("undrawn")
def test_damaged_contents_of_a_report_are_refused_in_a_sentence(few: Made, tmp_path: Path) -> None:
    job = stored_job(tmp_path, few)
    file = job.store.report(NAME) / "contents.json"
    damaged = ("{", "[]", '{"title": "a", "pictures": [3]}', "[" * 100_000, PRIVATE)
    for contents in damaged:
        file.write_text(contents)
        with pytest.raises(WorkFailed, match=r"contents\.json is not as the run wrote it"):
            finish(job, _outcomes(job))


def test_a_run_to_the_motion_has_a_verdict_and_one_before_has_none(few, tmp_path):
    job = stored_job(tmp_path, few)
    stages = [o.stage for o in _outcomes(job)]
    motion = stages.index("refine_sync") + 1
    verdict = verdict_of_run(job, _outcomes(job)[:motion])
    assert "one more video" not in " ".join(verdict.summary)  # the uncertainty has not been made
    assert verdict_of_run(job, _outcomes(job)[: motion - 1]) is None


def test_a_run_that_stops_early_has_no_page(few: Made, tmp_path: Path) -> None:
    job = stored_job(tmp_path, few)
    early = [o for o in _outcomes(job) if o.stage != "evaluate"]
    assert not complete({o.stage: o.stored for o in early})
    assert finish(job, early) is None
    assert not (job.store.report(NAME) / "report.html").exists()
