"""The page at the end of a run: made once, made again only when something has changed."""

from pathlib import Path

import pytest

from imocap_core.errors import WorkFailed
from imocap_core.pipeline.runner import Job, Outcome
from imocap_core.report.action_report import complete, finish, verdict_of_run
from imocap_core.report.page_files import prose, refresh_pages
from tests.pipeline.stored import NAME, stored_job
from tests.report.made import Made


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(frames=12)


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without pictures, of which one test alone speaks."""
    monkeypatch.setattr("imocap_core.report.write_page.draw_page_figures", lambda *_: [])


def _outcomes(job: Job, how: str = "cached") -> list[Outcome]:
    stored = {stage: job.store.load(NAME, stage) for stage in job.pipeline.stages}
    return [Outcome(s, how, r, 1.5) for s, r in stored.items() if r is not None]  # type: ignore[arg-type]


def test_the_page_is_made_once_and_again_when_something_changed(made: Made, tmp_path: Path) -> None:
    job = stored_job(tmp_path, made, filmed=("v1",))
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
    made, tmp_path
):
    job = stored_job(tmp_path, made)
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
def test_damaged_contents_of_a_report_are_refused_in_a_sentence(made: Made, tmp_path: Path) -> None:
    job = stored_job(tmp_path, made)
    file = job.store.report(NAME) / "contents.json"
    damaged = ("{", "[]", '{"title": "a", "pictures": [3]}', "[" * 100_000, PRIVATE)
    for contents in damaged:
        file.write_text(contents)
        with pytest.raises(WorkFailed, match=r"contents\.json is not as the run wrote it"):
            finish(job, _outcomes(job))


def test_a_run_to_the_motion_has_a_verdict_and_one_before_has_none(made, tmp_path):
    job = stored_job(tmp_path, made)
    stages = [o.stage for o in _outcomes(job)]
    motion = stages.index("refine_sync") + 1
    verdict = verdict_of_run(job, _outcomes(job)[:motion])
    assert "one more video" not in " ".join(verdict.summary)  # the uncertainty has not been made
    assert verdict_of_run(job, _outcomes(job)[: motion - 1]) is None


def test_a_run_that_stops_early_has_no_page(made: Made, tmp_path: Path) -> None:
    job = stored_job(tmp_path, made)
    early = [o for o in _outcomes(job) if o.stage != "evaluate"]
    assert not complete({o.stage: o.stored for o in early})
    assert finish(job, early) is None
    assert not (job.store.report(NAME) / "report.html").exists()
