"""The coach's card: the largest differences, on one sheet and on a phone."""

import re
from pathlib import Path

import pytest

from imocap_core.body import load_free_body
from imocap_core.diagnostics.findings import Verdict
from imocap_core.figures.sheets import sheet_videos
from imocap_core.report.first_page import SureDifference, card_page, largest_differences
from tests.report.browser import CHROMIUM, Browser
from tests.report.made import Made


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
