"""The comparison's page in a real headless Chromium: bodies, curves, sentences, measuring."""

from collections.abc import Iterator

import numpy as np
import pytest

from imocap_core.compare.compare import describe, pair_angles, pair_on_one_axis, performances_of
from imocap_core.compare.parts import chance_of, pair_findings
from imocap_core.compare.technique_report import pair_page
from tests.compare.test_compare import of_two_performers
from tests.pipeline.made_result import made_result
from tests.report.browser import CHROMIUM, PAINTED, Browser

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine")

LEFT_ARM = (16, 18, 20)  # shoulder, elbow, wrist


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    result = of_two_performers(made_result(tmp_path_factory.mktemp("made")), 20.0)
    first, second = (describe(performances_of(result, performer=p)) for p in ("Ann", "Bo"))
    pair = pair_on_one_axis(first, second)
    angles = pair_angles(pair)
    chance = chance_of(angles[0].each, angles[1].each, np.random.default_rng(0))
    return pair_page(pair, angles, pair_findings(pair, angles, chance), chance)


@pytest.fixture(scope="module")
def browser(page: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    folder = tmp_path_factory.mktemp("browser")
    (folder / "report.html").write_text(page, encoding="utf-8")
    with Browser(folder / "profile", 1000, 700) as opened:
        opened.open(folder / "report.html")
        opened.wait("window.imocap !== undefined || !document.getElementById('trouble').hidden")
        yield opened
        assert opened.errors == []


def measured(browser: Browser) -> list[str]:
    browser.drawn()
    text: str = browser.value("document.getElementById('measured').textContent")
    return text.splitlines()


def test_the_page_needs_no_other_file(page: str) -> None:
    assert "http" not in page.split("<script>")[1].replace("http://www.w3.org", "")
    assert len(page) < 3_000_000


def test_a_sentence_leads_to_its_moment_and_its_curves(browser: Browser) -> None:
    sentence = browser.value("document.querySelector('#findings button').textContent")
    assert sentence.startswith("left arm raised: Bo ")
    assert "(raised 20° higher), at " in sentence
    browser.value("imocap.act.angle('right_knee_flexion'); imocap.act.seek(0)")
    browser.value("document.querySelector('#findings button').click()")
    browser.drawn()
    assert browser.value("document.getElementById('angle').value") == "left_shoulder_elevation"
    said = float(sentence.split(" at ")[1].split(" s")[0])
    assert browser.value("imocap.act.state.phase") == pytest.approx(said, abs=0.006)
    button = "document.querySelector('#findings button').getAttribute('aria-current')"
    assert browser.value(button) == "true"
    assert browser.value("document.querySelectorAll('#rings .ringed').length") == 2


def test_joints_are_measured_without_a_mouse(browser: Browser) -> None:
    browser.value("imocap.act.measure(null)")
    for joint in ("left hip", "left knee"):
        browser.value(
            f"document.getElementById('joint').value = imocap.page.model.joints.indexOf('{joint}')"
        )
        browser.value("document.getElementById('add').click()")
    what, *each = measured(browser)
    assert what == "from left hip to left knee"
    assert all(20 < float(text.split(": ")[1].removesuffix(" cm")) < 60 for text in each)
    browser.value("document.getElementById('clear').click()")


def test_distances_and_angles_of_clicked_joints(browser: Browser) -> None:
    browser.value("imocap.act.measure(null)")
    joints = np.array(browser.value("imocap.actors().map(a => a.joints.slice(0, 22))"))
    for n, joint in enumerate(LEFT_ARM, start=1):
        x, y = browser.value(
            "(() => { const r = document.getElementById('stage').getBoundingClientRect();"
            f"const at = imocap.where(0, {joint}); return [r.x + at.x, r.y + at.y]; }})()"
        )
        browser.click(x, y)
        what, *each = measured(browser)
        if n == 1:
            assert what == "height of left shoulder"
            assert each[0] == f"Ann: {100 * joints[0, joint, 1]:.1f} cm"
        if n == 2:
            length = 100 * np.linalg.norm(joints[0, joint] - joints[0, LEFT_ARM[0]])
            assert what == "from left shoulder to left elbow"
            assert each == [f"Ann: {length:.1f} cm", f"Bo: {length:.1f} cm"]  # one body
    a, b, c = joints[1, LEFT_ARM, :]
    cosine = np.dot(a - b, c - b) / np.linalg.norm(a - b) / np.linalg.norm(c - b)
    assert what == "angle at left elbow, to left shoulder and left wrist"
    assert each[1] == f"Bo: {np.degrees(np.arccos(cosine)):.0f}°"
    assert browser.value("document.querySelectorAll('#rings circle:not(.ringed)').length") == len(
        LEFT_ARM
    )
    browser.key("Escape")
    assert measured(browser)[0].startswith("Click (or add) one joint")


def test_every_shown_body_has_its_curve(browser: Browser, page: str) -> None:
    browser.drawn()
    both = browser.value(PAINTED)
    browser.key("2")
    browser.drawn()
    assert 0 < browser.value(PAINTED) < 0.8 * both, "one curve of two is left"
    browser.key("2")
    assert '"sd":null' in page


def test_it_can_be_read_on_a_phone_and_in_both_themes(browser: Browser) -> None:
    browser.assert_readable(dark="18, 22, 27", light="243, 245, 247")
    browser.resize(390, 844, 2.0)
    browser.wait("document.documentElement.scrollWidth <= 390")
    browser.resize(1000, 700)
