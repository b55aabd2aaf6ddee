"""The viewer in a real headless Chromium: it loads, plays, obeys, and shows something."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.report.browser import CHROMIUM, Browser
from tests.report.made import Made
from tests.report.test_viewer import skinned
from tests.report.viewed import Page, page_of, write_clip

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")


@pytest.fixture(scope="module")
def page(made: Made, tmp_path_factory: pytest.TempPathFactory) -> Page:
    folder = tmp_path_factory.mktemp("clips")
    return page_of(made, files={"v1": write_clip(folder / "v1.mp4", 16)})


@pytest.fixture(scope="module")
def browser(page: Page, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    folder = tmp_path_factory.mktemp("browser")
    file = folder / "viewer with spaces.html"
    file.write_text(page.text, encoding="utf-8")
    with Browser(folder / "profile", 900, 600) as found:
        found.open(file)
        found.wait("window.imocap !== undefined || !document.getElementById('trouble').hidden")
        yield found
        assert found.errors == []


def picture(browser: Browser) -> np.ndarray:
    """The scene as shown, BGR."""
    browser.value("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")
    found = cv2.imdecode(np.frombuffer(browser.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    width, height = browser.value(
        "[document.getElementById('stage').clientWidth,"
        " document.getElementById('stage').clientHeight]"
    )
    return found[:height, :width]


def state(browser: Browser, name: str) -> object:
    return browser.value(f"imocap.act.state.{name}")


def test_it_loads_without_complaint(browser: Browser) -> None:
    assert browser.value("document.getElementById('trouble').hidden"), browser.value(
        "document.getElementById('trouble').textContent"
    )
    assert browser.value("document.getElementById('name').textContent") == "waving"
    assert browser.value("document.querySelectorAll('.card').length") == 3
    assert browser.errors == []


def test_the_scene_is_not_blank(browser: Browser) -> None:
    browser.value("imocap.act.fit(0)")
    shown = picture(browser)
    assert shown.std() > 10
    middle = shown[shown.shape[0] // 3 : -shown.shape[0] // 4].reshape(-1, 3).astype(float)
    colourful = middle.max(axis=1) - middle.min(axis=1) > 40
    assert 0.01 < colourful.mean() < 0.9, "bodies stand out from the grey ground"


def test_time_moves_while_it_plays_and_rests_when_told(browser: Browser) -> None:
    browser.value("imocap.act.seek(0)")
    browser.key(" ")
    browser.wait("imocap.act.state.phase > 0.05")
    browser.key(" ")
    browser.value("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")
    before = state(browser, "phase")
    browser.value("new Promise(r => setTimeout(r, 150))")
    assert state(browser, "phase") == before
    browser.key("Home")
    browser.key("ArrowRight")
    assert state(browser, "phase") == pytest.approx(
        browser.value("imocap.page.timeline.first") + 1 / 30
    )


def test_the_frame_shown_is_that_of_the_moment(browser: Browser) -> None:
    for frame in (2, 11):
        browser.value(f"imocap.act.seek({frame} / 30)")
        browser.wait(
            "document.querySelector('.card footer span').textContent === "
            f"'frame {frame}' && document.querySelector('.card canvas').width > 0"
        )
        light = (
            "(() => { const c = document.querySelector('.card canvas');"
            "return c.getContext('2d').getImageData(3, 3, 1, 1).data[0]; })()"
        )
        browser.wait(f"Math.abs({light} - {40 + 8 * frame}) < 5")


def test_hiding_every_video_leaves_the_ground(browser: Browser) -> None:
    full = picture(browser)
    for digit in "123":
        browser.key(digit)
    assert state(browser, "on") == [False, False, False]
    empty = picture(browser)
    spread = (empty.max(axis=2).astype(int) - empty.min(axis=2))[150:]
    assert (spread > 40).mean() < 0.002
    box = browser.value(
        "(() => { const r = document.querySelectorAll('.card input')[1].getBoundingClientRect();"
        "return [r.x + r.width / 2, r.y + r.height / 2]; })()"
    )
    browser.click(*box)
    assert state(browser, "on") == [False, True, False]
    for digit in "13":
        browser.key(digit)
    assert np.abs(picture(browser).astype(int) - full).mean() < 2.0


def test_keys_and_buttons_change_what_is_shown(browser: Browser) -> None:
    seen = [picture(browser)]
    for key, name, wanted in (
        ("i", "answer", "initial"),
        ("i", "answer", "both"),
        ("i", "answer", "final"),
        ("o", "apart", True),
        ("o", "apart", False),
        ("c", "through", 0),
        ("Escape", "through", -1),
    ):
        browser.key(key)
        assert state(browser, name) == wanted
        seen.append(picture(browser))
    for before, after in pairwise(seen):
        assert np.abs(before.astype(int) - after).mean() > 0.02
    browser.value(
        "[...document.querySelectorAll('button')].find(b => b.textContent == 'keys').click()"
    )
    browser.wait("!document.getElementById('help').hidden")
    browser.key("?")
    browser.wait("document.getElementById('help').hidden")


def test_bones_in_the_page_are_the_body_s(browser: Browser, page: Page) -> None:
    rows = browser.value("Array.from(imocap.pose(1, 'final', 7).rows)")
    bones = np.array(rows).reshape(-1, 3, 4)
    shape = page.header["shapes"][page.header["videos"][1]["answers"]["final"]["shape"]]
    rest = page.array(shape["rest"], -1, 3) / 32767 * shape["scale"]
    model = page.header["model"]
    at, weights = page.array(model["bones"], -1, 4), page.array(model["weights"], -1, 4) / 65535
    blended = (weights[..., None, None] * bones[at]).sum(axis=1)
    shown = (blended[..., :3] @ rest[..., None])[..., 0] + blended[..., 3]
    assert np.abs(shown - skinned(page, 1, "final")[7]).max() < 2e-5


def test_it_fits_a_narrow_screen(browser: Browser) -> None:
    browser.resize(390, 780, 2.0)
    try:
        browser.wait("document.documentElement.scrollWidth <= 390")
        assert picture(browser).size > 0
    finally:
        browser.resize(900, 600)


def test_a_video_of_another_action_has_no_place(
    made: Made, browser: Browser, page: Page, tmp_path: Path
) -> None:
    sync = made.refined.sync.model_copy(update={"excluded": ["v2"]})
    other = page_of(made, "two of three", sync=sync)
    assert other.header["videos"][1]["role"] == "another action"
    before, after = tmp_path / "other.html", tmp_path / "again.html"
    before.write_text(other.text, encoding="utf-8")
    after.write_text(page.text, encoding="utf-8")
    browser.open(before)
    browser.wait("window.imocap?.page.title === 'two of three'")
    said = "[...document.querySelectorAll('.card')].map(c => c.querySelector('footer').innerText)"
    browser.wait(f"{said}[1].includes('not synchronised') && {said}[0].includes('sure 80 %')")
    browser.key("c")
    browser.key("c")
    assert state(browser, "through") == 2
    browser.open(after)
    browser.wait("window.imocap?.page.title === 'waving'")
