"""The report's page in a real headless Chromium: on a phone and in both themes."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from imocap_core.artifacts.schemas import Table
from imocap_core.diagnostics.findings import Verdict
from imocap_core.report.page import html_page, sections
from imocap_core.report.table_files import GLOSSARY, Contents, Picture
from tests.report.browser import CHROMIUM, Browser
from tests.report.test_report_page import FIRST, PAGES

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")

METRICS = [name for name in GLOSSARY if name.endswith("_mm")]


def test_it_can_be_read_on_a_phone_and_in_both_themes(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "warp.png"), np.full((300, 1400, 3), 200, np.uint8))
    rows = [["after loop", *[1.0] * len(METRICS)]]
    tables = [
        Table(name="pose", title="Wide", columns=["result", *METRICS], rows=rows),
        Table(name="unscored", title="Not scored", columns=["metric", "reason"],
              rows=[["mpjpe_mm", "a reason that is far too long for one line " * 3]]),
    ]  # fmt: skip
    parts = sections(tables, [Picture("warp.png", "The warp.")])
    cv2.imwrite(str(tmp_path / "angles.png"), np.full((300, 900, 3), 200, np.uint8))
    verdict = Verdict(("Three videos are synchronised.",), (), 0.2)
    page = html_page(tmp_path, Contents("waving", ()), verdict, parts, PAGES, "0", "", FIRST)
    (tmp_path / "report.html").write_text(page, encoding="utf-8")
    with Browser(tmp_path / "profile", 390, 844) as browser:
        phone = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
        browser.call("Emulation.setDeviceMetricsOverride", **phone)
        browser.open(tmp_path / "report.html")
        assert browser.value("document.getElementById('technical').open") is False
        assert browser.sheets() == 1
        browser.value("document.getElementById('technical').open = true")
        assert browser.value("[innerWidth, document.documentElement.scrollWidth]") == [390, 390]
        sizes = browser.value(
            "[...document.querySelectorAll('p, li, td, th, dd, a')]"
            ".map(e => parseFloat(getComputedStyle(e).fontSize))"
        )
        assert min(sizes) >= 14
        assert browser.value("document.querySelector('img').getBoundingClientRect().width") == 860
        browser.assert_readable(light="255, 255, 255", dark="23, 28, 33")
        assert browser.errors == []
