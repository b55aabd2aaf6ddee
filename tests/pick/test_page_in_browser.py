"""The page in a real headless Chromium: clicks, drags, keys and fingers change action.yaml."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from imocap_core.pick.server import picking
from tests.pick.conftest import CUT, FRAMES
from tests.report.browser import CHROMIUM, Browser

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")

TAB, ENTER, LEFT, RIGHT, DOWN, DELETE = 9, 13, 37, 39, 40, 46


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("browser") / "profile") as opened:
        yield opened


@pytest.fixture
def page(browser: Browser, root: Path) -> Iterator[Page]:
    browser.errors.clear()
    with picking("made", [], root) as served:
        browser.resize(1280, 800)
        browser.visit(served.address)
        browser.wait(
            "[...document.querySelectorAll('.video .state')].filter("
            "s => s.textContent.includes('likely person 1')).length === 2"
        )
        browser.wait("document.querySelectorAll('#outlines .person').length === 2")
        yield Page(browser, root / "actions" / "made" / "action.yaml")
        assert browser.errors == []
        browser.call("Page.navigate", url="about:blank")


class Page:
    """The page, and the action.yaml that it writes."""

    def __init__(self, browser: Browser, file: Path) -> None:
        self.browser, self.file = browser, file

    def data(self) -> dict[str, Any]:
        content: dict[str, Any] = yaml.safe_load(self.file.read_text())
        return content

    def video(self, name: str) -> dict[str, Any]:
        return {video["id"]: video for video in self.data()["videos"]}[name]

    def middle(self, selector: str) -> tuple[float, float]:
        """The middle of an element, once the page has it, enabled, and nothing covers it."""
        find = f"const e = document.querySelector({selector!r}); if (!e || e.disabled) return null;"
        place = (
            "e.scrollIntoView({block: 'center'}); const b = e.getBoundingClientRect();"
            "const x = b.x + b.width / 2, y = b.y + b.height / 2;"
            "const top = document.elementFromPoint(x, y);"
            "return top && (e.contains(top) || top.contains(e)) ? [x, y] : null;"
        )
        found = f"(() => {{ {find} {place} }})()"
        self.browser.wait(f"{found} !== null")
        x, y = self.browser.value(found)
        return x, y

    def click(self, selector: str) -> None:
        self.browser.click(*self.middle(selector))

    def until(self, ready: Callable[[], bool]) -> None:
        """Until what is in the file is so."""
        for _ in range(200):
            if ready():
                return
            self.browser.value("new Promise(r => setTimeout(r, 50))")
        raise AssertionError(self.file.read_text())


def strip(name: str, part: str) -> str:
    return f'.video[aria-label="Video {name}"] {part}'


def test_a_person_is_clicked(page: Page) -> None:
    page.click('#outlines .person[data-number="2"] .body')
    page.until(lambda: "person" in page.video("v1"))
    person = page.video("v1")["person"]
    assert person["frame"] == FRAMES // 2
    x0, _, x1, _ = person["box"]
    assert x0 < 280 < x1
    page.browser.wait(
        "document.querySelector('#outlines .chosen')?.dataset.number === '2' && "
        f"document.querySelector({strip('v1', '.state')!r}).textContent.includes('person 2')"
    )
    page.click("#undo")
    page.until(lambda: "person" not in page.video("v1"))


def test_a_span_is_dragged_and_the_performer_goes_with_it(page: Page) -> None:
    page.click('.chip[data-chip="1"]')
    page.until(lambda: "person" in page.video("v1"))
    x0, x1 = page.browser.value(
        f"(() => {{ const b = document.querySelector({strip('v1', '.strip')!r})"
        ".getBoundingClientRect(); return [b.left, b.right]; })()"
    )
    start = page.middle(strip("v1", ".grip.first"))
    page.browser.drag(start, (start[0] + (x1 - x0) * 30 / FRAMES, start[1]))
    page.until(lambda: "frames" in page.video("v1"))
    first, stop = page.video("v1")["frames"]
    assert abs(first - 30) <= 1
    assert stop == FRAMES
    assert page.video("v1")["person"]["frame"] == first


def test_a_point_is_enough_before_people_are_outlined(page: Page, root: Path) -> None:
    page.file.write_text(page.file.read_text().replace("keypoints: v2", "keypoints: detect"))
    page.browser.wait("document.getElementById('find').disabled === false")
    page.click(strip("v2", "h3 button"))
    page.browser.wait("document.querySelectorAll('#outlines .person').length === 0")
    page.click("#picture")
    page.until(lambda: "person" in page.video("v2"))
    person = page.video("v2")["person"]
    assert person["frame"] == FRAMES // 2
    assert person["at"] == pytest.approx([160, 90], abs=2)
    page.browser.wait("document.querySelectorAll('#outlines .place').length > 0")


def test_mirrored_shots_and_dropping(page: Page) -> None:
    page.browser.value(
        f"(() => {{ const s = document.querySelector({strip('v2', 'select')!r});"
        "s.value = 'true'; s.dispatchEvent(new Event('change')); })()"
    )
    page.until(lambda: page.video("v2").get("mirrored") is True)
    buttons = f"[...document.querySelectorAll({strip('v1', 'footer button')!r})]"
    page.browser.value(f"{buttons}.find(b => b.textContent === 'Split into 2 shots').click()")
    page.until(lambda: len(page.data()["videos"]) == 3)
    assert page.video("v1")["frames"] == [0, CUT]
    assert page.video("v1_2")["frames"] == [CUT, FRAMES]
    page.browser.wait("document.querySelectorAll('.video').length === 3")
    page.click('[aria-label="Drop v1_2"]')
    page.until(lambda: len(page.data()["videos"]) == 2)
    page.browser.wait("document.querySelector('#toast.shown #toast-undo') !== null")
    page.browser.value("document.getElementById('toast-undo').click()")
    page.until(lambda: len(page.data()["videos"]) == 3)
    assert "# first" in page.file.read_text()


def test_performers_one_event_and_frames_that_match_nothing(page: Page) -> None:
    browser = page.browser
    for name, performer in (("v1", "anna"), ("v2", "ben")):
        page.click(strip(name, ".performer"))
        browser.call("Input.insertText", text=performer)
        browser.press("Enter", ENTER)
        if name == "v1":  # every video has a name, or none has
            browser.wait("document.getElementById('toast-text').textContent.includes('in v2 too')")
            assert "performer" not in page.video("v1")
    page.until(lambda: page.video("v2").get("performer") == "ben")
    assert page.video("v1")["performer"] == "anna"
    page.click("#event")
    page.until(lambda: page.data().get("event") is True)
    browser.value("document.activeElement.blur()")
    page.click(strip("v1", "h3 button"))
    browser.value("document.activeElement.blur()")
    browser.press("x", ord("X"))
    browser.wait("document.getElementById('ignore').textContent === 'To here'")
    browser.press("ArrowLeft", LEFT, shift=True)
    page.click("#ignore")
    page.until(lambda: "forbidden" in page.data())
    assert page.data()["forbidden"] == [
        {"video": "v1", "frames": [FRAMES // 2 - 10, FRAMES // 2 + 1]}
    ]
    browser.wait("document.querySelectorAll('.ignored').length === 1")
    page.click("#ignored-list button[aria-label]")
    page.until(lambda: "forbidden" not in page.data())
    for _ in range(3):
        page.click("#undo")
        browser.wait("new Promise(r => setTimeout(() => r(true), 150))")
    page.until(lambda: page.data().get("event") is None)
    assert page.video("v1")["performer"] == "anna"


def test_the_selected_video_plays(page: Page) -> None:
    frame = "Number(document.getElementById('scrub').value)"
    began = page.browser.value(frame)
    page.click("#play")
    page.browser.wait(f"{frame} > {began} + 1")
    page.browser.press("p", ord("P"))
    rest = page.browser.value(f"new Promise(r => setTimeout(() => r({frame}), 50))")
    page.browser.value("new Promise(r => setTimeout(r, 200))")
    assert page.browser.value(frame) == rest
    assert page.browser.value("document.getElementById('play').ariaLabel") == "Play"


def test_everything_by_keyboard(page: Page) -> None:
    press = page.browser.press
    for _ in range(40):  # Tab reaches a person of the large frame
        press("Tab", TAB)
        if page.browser.value("document.activeElement.matches('#outlines .person')"):
            break
    name = page.browser.value("document.activeElement.getAttribute('aria-label')")
    outline = page.browser.value(
        "getComputedStyle(document.activeElement.querySelector('.case')).strokeWidth"
    )
    assert name == "Person 1"
    assert outline == "11px"
    press("Enter", ENTER)
    page.until(lambda: "person" in page.video("v1"))
    for _ in range(60):  # and the grips
        press("Tab", TAB)
        if page.browser.value("document.activeElement.matches('.grip.first')"):
            break
    assert page.browser.value("document.activeElement.getAttribute('aria-valuenow')") == "0"
    for _ in range(4):
        press("ArrowRight", RIGHT)
    page.until(lambda: page.video("v1").get("frames") == [4, FRAMES])
    assert page.browser.value("document.activeElement.matches('.grip.first')"), "it keeps the focus"
    page.browser.value("document.activeElement.blur()")
    press("m", ord("M"))
    press("ArrowDown", DOWN)
    page.browser.wait("document.getElementById('stage-name').textContent === 'v2'")
    press("ArrowLeft", LEFT, shift=True)
    press("m", ord("M"))
    page.browser.wait("document.querySelector('#save-anchor:not(:disabled)') !== null")
    press("Enter", ENTER)
    page.until(lambda: "anchors" in page.data())
    moment = page.browser.value("Number(document.getElementById('scrub').value)")
    assert page.data()["anchors"] == [{"v1": 4, "v2": moment}]
    press("[", 219)
    page.until(lambda: page.video("v2").get("frames") == [moment, FRAMES])
    press("2", ord("2"))
    page.until(lambda: page.video("v2").get("person") is not None)
    press("0", ord("0"))
    page.until(lambda: page.video("v2").get("person") is None)
    press("Delete", DELETE)
    page.until(lambda: len(page.data()["videos"]) == 1)
    press("z", ord("Z"), control=True)
    page.until(lambda: len(page.data()["videos"]) == 2 and "anchors" in page.data())


def test_everything_can_be_read(page: Page) -> None:
    """Names for screen readers, and a contrast of at least 4.5 (WCAG 2.2, 1.4.3) in both themes."""
    page.browser.assert_named("button", "slider", "combobox", "checkbox", "link", "textbox")
    page.browser.assert_readable(light="241, 244, 247", dark="19, 23, 28")


def test_a_phone_and_a_finger(page: Page) -> None:
    phone = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
    page.browser.call("Emulation.setDeviceMetricsOverride", **phone)
    page.browser.call("Emulation.setTouchEmulationEnabled", enabled=True)
    try:
        page.browser.wait("document.documentElement.clientWidth === 390")
        assert page.browser.value("document.documentElement.scrollWidth") <= 390
        small = page.browser.value(
            "[...document.querySelectorAll('button, select, summary, input[type=text]')].filter("
            "e => { const b = e.getBoundingClientRect();"
            "return b.width && (b.height < 43.5 || b.width < 43.5); }).map(e => e.outerHTML)"
        )
        assert small == []
        page.browser.touch(page.middle('#outlines .person[data-number="1"] .body'))
        page.until(lambda: "person" in page.video("v1"))
        grip = page.middle(strip("v1", ".grip.last"))
        page.browser.touch(grip, (grip[0] - 30, grip[1]), (grip[0] - 80, grip[1]))
        page.until(lambda: "frames" in page.video("v1"))
        first, stop = page.video("v1")["frames"]
        assert first == 0
        assert CUT < stop < FRAMES - 4
        x, y = page.middle(strip("v2", ".strip"))
        height = page.browser.value("scrollY")
        page.browser.touch((x - 50, y))
        page.browser.wait("document.getElementById('stage-name').textContent === 'v2'")
        assert page.browser.value("scrollY") == height > 0  # a redraw does not scroll back
        assert page.browser.value("Number(document.getElementById('scrub').value)") < FRAMES // 2
    finally:
        page.browser.call("Emulation.setTouchEmulationEnabled", enabled=False)


def test_a_change_from_elsewhere_is_told_and_done_ends_the_page(page: Page) -> None:
    text = page.file.read_text()
    page.file.write_text(text.replace("id: v2", "id: v1"))
    page.browser.wait("document.getElementById('fault').textContent.includes('got v1 twice')")
    page.file.write_text(text + "# by hand\n")
    page.browser.wait("document.getElementById('fault').hidden")
    page.click('.chip[data-chip="1"]')
    page.until(lambda: "person" in page.video("v1"))
    assert page.file.read_text().endswith("# by hand\n")
    page.click("#done")
    page.browser.wait("!document.getElementById('end').hidden")
    assert "run made" in page.browser.value("document.getElementById('end-command').textContent")
