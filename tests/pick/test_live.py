"""The page that follows a run: what it says and shows, from nothing to the viewer."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from imocap_core.errors import WrongUse
from imocap_core.pick.live import following
from imocap_core.pipeline.generation import AT_WORK, LAST_RUN
from tests.pick.made import Asker
from tests.pipeline.stored import NAME, stored_job
from tests.report.browser import CHROMIUM, Browser
from tests.report.made import Made
from tests.report.viewed import Page


@pytest.mark.long
def test_it_follows_a_run_to_the_viewer(tmp_path: Path) -> None:
    job = stored_job(tmp_path, Made(frames=12), filmed=("v1",))
    folder, shown = job.store.folder / NAME, {}
    with following(NAME, tmp_path) as served:
        asker = Asker(served, folder)
        with job.store.lock(NAME, lambda: None):
            for stage in ("keypoints", "camera_motion", "sync", "refine_sync"):
                doing = {"stage": stage, "share": 0.5, "what": "round 1: sync"}
                (folder / AT_WORK).write_text(json.dumps(doing))
                state = asker.state()
                assert state["sentence"].startswith(f"The run is at work, {stage.split('_')[0]}")
                shown[stage] = state["shown"]
                if shown[stage] in ("keypoints", "motion"):
                    strip = np.frombuffer(asker.ask("strips/0.jpg")[1], np.uint8)
                    assert cv2.imdecode(strip, cv2.IMREAD_COLOR).std() > 10
            assert list(shown.values()) == ["nothing", "keypoints", "motion", "viewer"]
            draft = Page(asker.ask("viewer.html")[1].decode())
            assert draft.header["verdict"] is None
            assert asker.ask("strips/9.jpg")[0].status == 404
        state = asker.state()  # the file of a killed run does not deceive
        assert (state["sentence"], len(state["rounds"])) == ("The run has ended.", 2)
        assert Page(asker.ask("viewer.html")[1].decode()).header["verdict"]["level"] == "check"
        assert asker.ask("state", token="x")[0].status == 403
        if CHROMIUM is not None:
            with Browser(tmp_path / "profile", 900, 600) as browser:
                browser.visit(served.address)
                browser.wait("!document.getElementById('viewer').hidden")
                browser.wait("document.getElementById('viewer').contentWindow.imocap")
                assert browser.errors == []


def test_it_says_why_there_is_nothing(tmp_path: Path) -> None:
    job = stored_job(tmp_path, Made(frames=12))
    for stage in job.pipeline.stages:
        job.store.current(NAME, stage).unlink()
    with following(NAME, tmp_path) as served:
        asker = Asker(served, tmp_path)
        assert "Nothing has been made yet" in asker.state()["sentence"]
        assert asker.ask("viewer.html")[0].status == 404
        (job.store.folder / NAME / LAST_RUN).write_text('{"error": "v1 is no video"}')
        assert asker.state()["sentence"] == "The last run ended: v1 is no video"
    with pytest.raises(WrongUse, match="no action 'other'"), following("other", tmp_path):
        pass
