"""The viewer in a real headless Chromium: it loads, plays, obeys, and shows something."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from imocap_core.figures.style import VIDEO_COLORS
from tests.report.browser import CHROMIUM, PAINTED, Browser
from tests.report.made import Made
from tests.report.viewed import Page, page_of, write_clip
from tests.viewer.test_viewer import skinned

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
    browser.drawn()
    found = cv2.imdecode(np.frombuffer(browser.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    x, y, width, height = browser.value(
        "(() => { const r = document.getElementById('stage').getBoundingClientRect();"
        "return [r.x, r.y, r.width, r.height].map(Math.round); })()"
    )
    return found[y : y + height, x : x + width]


def state(browser: Browser, name: str) -> object:
    return browser.value(f"imocap.act.state.{name}")


def test_it_loads_without_complaint(browser: Browser) -> None:
    assert browser.value("document.getElementById('trouble').hidden")
    assert browser.value("document.getElementById('name').textContent") == "waving"
    assert browser.value("document.querySelectorAll('.card').length") == 3
    assert browser.errors == []


def test_it_opens_at_the_first_moment_that_all_videos_share(browser: Browser) -> None:
    """The third video starts four frames late."""
    assert state(browser, "phase") == pytest.approx(4 / 30)
    assert "before the clip" not in browser.value("document.getElementById('cards').innerText")


def test_time_moves_while_it_plays_and_rests_when_told(browser: Browser) -> None:
    browser.value("imocap.act.seek(0)")
    browser.key(" ")
    browser.wait("imocap.act.state.phase > 0.05")
    browser.key(" ")
    browser.drawn()
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
        ("o", "place", "one"),
        ("o", "place", "all"),
        ("o", "place", "apart"),
        ("u", "uncertainty", True),
        ("b", "skeletons", True),
        ("u", "uncertainty", False),
        ("b", "skeletons", False),
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
    browser.press("Escape", 27)
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


def test_slider_and_cursors_are_above_one_another(browser: Browser, page: Page) -> None:
    line = page.header["timeline"]
    for share in (0.0, 0.3, 1.0):
        browser.value(f"imocap.act.seek({line['first'] + share * (line['last'] - line['first'])})")
        browser.drawn()
        track, lanes = browser.value(
            "['scrub', 'lanes'].map(id => { const r = document.getElementById(id)"
            ".getBoundingClientRect(); return [r.x, r.width]; })"
        )
        thumb = track[0] + 8 + share * (track[1] - 16)
        dark = browser.value(
            "(() => { const c = document.getElementById('lanes');"
            "const d = c.getContext('2d').getImageData(0, 1, c.width, 1).data, x = [];"
            "for (let i = 0; i < c.width; i++) if (d[4 * i + 3] > 60 && d[4 * i] < 60) x.push(i);"
            "return x.map(i => i + 0.5); })()"
        )
        assert lanes[0] + np.mean(dark) == pytest.approx(thumb, abs=1.0)


def test_a_span_is_played_again_and_again(browser: Browser) -> None:
    for at in (0.2, 0.3):
        browser.value(f"imocap.act.seek({at})")
        browser.key("l")
    assert state(browser, "loop") == pytest.approx([0.2, 0.3])
    phases = browser.value(
        "Array.from({length: 8}, () => (imocap.act.advance(0.03), imocap.act.state.phase))"
    )
    assert all(0.2 <= p <= 0.3 for p in phases)
    assert phases[0] == pytest.approx(0.2)
    assert min(np.diff(phases)) < 0
    browser.value("document.getElementById('film').click()")
    command = "imocap video waving --from 0.20 --to 0.30"
    browser.wait(f"document.getElementById('legend').textContent.includes('{command}')")
    browser.key("l")
    assert state(browser, "loop") == []


def test_an_address_opens_at_a_moment(browser: Browser) -> None:
    browser.value("location.hash = '#t=0.4&loop=0.1,0.5'")
    browser.wait("Math.abs(imocap.act.state.phase - 0.4) < 1e-9")
    assert state(browser, "loop") == pytest.approx([0.1, 0.5])
    browser.key("l")
    browser.value("imocap.act.seek(0.25)")
    browser.wait("location.hash === '#t=0.25'")
    browser.value("location.hash = '#t=nonsense'")
    browser.value("new Promise(r => setTimeout(r, 50))")
    assert state(browser, "phase") == pytest.approx(0.25)


def test_a_link_keeps_view_and_mode(browser: Browser) -> None:
    browser.value("navigator.clipboard && (navigator.clipboard.writeText = () => Promise.reject())")
    before = browser.value("[imocap.act.place('all'), JSON.stringify(imocap.act.state)][1]")
    browser.value(
        "imocap.act.answer('both'), imocap.act.flip('skeletons'), imocap.act.flip('paths'),"
        "imocap.act.toggle(1, false), imocap.orbit.azimuth = 1.25, imocap.act.seek(0.3)"
    )
    link = browser.value("imocap.act.link().then(() => location.hash)")
    browser.value(
        "imocap.act.answer('final'), imocap.act.flip('skeletons'), imocap.act.flip('paths'),"
        "imocap.act.toggle(1, true), imocap.act.place('apart'), imocap.act.seek(0.1)"
    )
    browser.wait("location.hash.startsWith('#t=0.1')")  # at rest, without the view
    browser.value(f"location.hash = '{link}'")
    browser.wait("imocap.act.state.phase === 0.3 && imocap.act.state.place === 'all'")
    shown = "['answer', 'skeletons', 'paths', 'on'].map(name => imocap.act.state[name])"
    assert browser.value(shown) == ["both", True, False, [True, False, True]]
    assert browser.value("imocap.orbit.azimuth") == 1.25
    browser.value(f"Object.assign(imocap.act.state, {before}), imocap.act.place('apart')")


def test_the_eye_stays_above_the_ground(browser: Browser) -> None:
    before = browser.value("[imocap.orbit.azimuth, imocap.orbit.elevation, imocap.orbit.distance]")
    x, y, width, height = browser.value(
        "(() => { const r = document.getElementById('stage').getBoundingClientRect();"
        "return [r.x, r.y, r.width, r.height]; })()"
    )
    browser.drag((x + width / 2, y + height - 5), (x + width / 2, y + 5))
    assert browser.value("imocap.orbit.elevation") < before[1]
    assert browser.value("imocap.orbit.eye()[1]") == pytest.approx(0.08, abs=1e-6)
    browser.value("imocap.orbit.pan(0, -900)")
    assert browser.value("imocap.orbit.eye()[1]") >= 0.0799
    browser.value("imocap.orbit.elevation = 0.25; imocap.act.fit(0)")


def test_curves_of_chosen_joints(browser: Browser) -> None:
    browser.value("imocap.act.state.curves.joints = [21], imocap.act.seek(0.3)")
    browser.drawn()
    one = browser.value(PAINTED)
    assert one > 50
    browser.value("[20, 4, 18].forEach(j => imocap.act.joint(j, true))")
    browser.drawn()
    assert browser.value(PAINTED) > 1.5 * one
    assert "left knee" in browser.value("document.getElementById('chosen').textContent")
    bend = "imocap.curves.course(0, 'final', 4, 'bend')"
    browser.value("imocap.act.quantity('bend')")
    assert 0 < browser.value(f"Math.max(...{bend})") < 60
    browser.value("[20, 4, 18].forEach(j => imocap.act.joint(j, false))")
    browser.value("imocap.act.quantity('height')")


def test_a_picture_is_saved_and_named_by_its_moment(browser: Browser) -> None:
    browser.value(
        "HTMLAnchorElement.prototype.click = function () { window.saved = this.download; }"
    )
    browser.value("imocap.act.seek(0.3)")
    browser.key("p")
    browser.wait("window.saved === 'waving_0.30s.png'")


def test_everything_can_be_read(browser: Browser) -> None:
    """Names for screen readers, and a contrast of at least 4.5 (WCAG 2.2, 1.4.3) in both themes,
    of a pressed button under the pointer too."""
    browser.assert_named("button", "slider", "combobox", "checkbox", "image", "toolbar")
    canvases = browser.value(
        "[...document.querySelectorAll('canvas')].filter(c => !c.getAttribute('aria-label')).length"
    )
    assert canvases == 0
    x, y = browser.value(
        "(() => { const b = [...document.querySelectorAll('#tools button')]"
        ".find(b => b.getAttribute('aria-pressed') === 'true').getBoundingClientRect();"
        "return [b.x + b.width / 2, b.y + b.height / 2]; })()"
    )
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    for theme, ground in (("light", "243, 245, 247"), ("dark", "18, 22, 27")):
        browser.assert_readable(**{theme: ground})
        assert browser.value("document.querySelector('#tools button:hover') !== null")
        for color in VIDEO_COLORS:
            ratio = browser.value(
                "(() => { const ground = imocap.rgb(imocap.theme().paper);"
                f"const ink = imocap.readable('{color}', imocap.theme().paper).match(/\\d+/g);"
                "return imocap.contrast(ink.map(x => x / 255), ground); })()"
            )
            assert ratio >= 4.5, (theme, color)


def test_less_detail_where_the_processor_draws(browser: Browser) -> None:
    fine, coarse = browser.value(
        "[imocap.scene.meshes[0].fine.count, imocap.scene.meshes[0].coarse.count]"
    )
    assert 0.02 < coarse / fine < 0.15
    assert browser.value("imocap.detail().software") is True
    assert browser.value("imocap.detail().level") >= 1


@pytest.mark.parametrize("size", [(390, 844), (844, 390)])
def test_on_a_phone_the_scene_stays_in_sight(browser: Browser, size: tuple[int, int]) -> None:
    width, height = size
    browser.resize(width, height, 2.0)
    try:
        browser.wait(f"document.documentElement.scrollWidth <= {width}")
        for place in (0, 5000):
            browser.value(f"scrollTo(0, {place})")
            top, bottom, play, end = browser.value(
                "(() => { const box = (id) => document.getElementById(id).getBoundingClientRect();"
                "const s = box('stage'); return [s.top, s.bottom, box('play').bottom,"
                " document.documentElement.scrollHeight]; })()"
            )
            assert top >= 0
            assert bottom - top >= 0.45 * height
            assert bottom <= play <= height
            assert end > height  # the rest lies below
    finally:
        browser.value("scrollTo(0, 0)")
        browser.resize(900, 600)


def check_frames(browser: Browser) -> set[int]:
    """Twenty looks while it plays: what is drawn is of the frame that skeleton and label name."""
    browser.value("imocap.act.state.loop = [0, 0.45], imocap.act.seek(0), imocap.act.play(true)")
    shown = browser.value(
        "(async () => { const out = [], card = document.querySelector('.card canvas');"
        "for (let n = 0; n < 20; n++) { await new Promise(r => setTimeout(r, 45));"
        "  out.push([card.getContext('2d').getImageData(3, 3, 1, 1).data[0], imocap.shown()[0],"
        "    document.querySelector('.card footer span').textContent]); }"
        "return out; })()"
    )
    browser.value("imocap.act.play(false), imocap.act.state.loop = []")
    for light, frame, label in shown:
        assert light == pytest.approx(40 + 8 * frame, abs=5)
        assert label == f"frame {frame}"
    return {frame for _, frame, _ in shown}


def test_while_it_plays_pictures_and_marks_are_of_one_frame(browser: Browser) -> None:
    assert browser.value("imocap.pictures[0].stream.then(s => s.constructor.name)") == (
        "PacketStream"
    )
    assert len(check_frames(browser)) > 1  # few where the processor is busy


def test_without_a_decoder_the_frames_come_from_an_element(page: Page, tmp_path: Path) -> None:
    file = tmp_path / "viewer.html"
    file.write_text(page.text, encoding="utf-8")
    with Browser(tmp_path / "profile", 900, 600) as old:
        old.call("Page.addScriptToEvaluateOnNewDocument", source="delete window.VideoDecoder")
        old.open(file)
        old.wait("window.imocap?.pictures[0].decoded.size > 0")
        assert old.value("imocap.pictures[0].stream.then(s => s.constructor.name)") == "Object"
        assert len(check_frames(old)) > 1
        assert old.errors == []


def test_the_verdict_is_there_and_its_spans_are_hatched(browser: Browser) -> None:
    assert browser.value("document.getElementById('level').textContent") == "Check"
    assert "nothing checks the timing" in browser.value(
        "document.getElementById('summary').textContent"
    )
    browser.value("imocap.act.seek(0.4)")
    browser.drawn()
    lanes = "document.getElementById('lanes').toDataURL()"
    before = browser.value(lanes)
    browser.value(
        "imocap.page.verdict.findings.push("
        "{video: 0, first: 0.1, last: 0.2, serious: true, sentence: 'v1 frames 3-6: wrong.'})"
    )
    browser.value("imocap.act.seek(0.4)")
    browser.drawn()
    assert browser.value(lanes) != before
    browser.value("imocap.act.seek(0.15)")
    browser.wait("document.getElementById('legend').textContent === 'v1 frames 3-6: wrong.'")
    browser.value("imocap.page.verdict.findings.pop(), imocap.act.seek(0.15)")
    browser.wait("document.getElementById('legend').textContent.startsWith('grid')")


def test_a_slider_leads_from_each_video_alone_to_all_together(browser: Browser) -> None:
    """Half the way is between the ends, and the ends are the two motions."""
    browser.value("imocap.act.seek(0.3)")
    pelvis = []
    for share in (0, 0.5, 1):
        browser.value(
            "(() => { const s = document.querySelector('#reveal input');"
            f"s.value = {share}; s.dispatchEvent(new Event('input')); }})()"
        )
        browser.drawn()
        pelvis.append(browser.value("imocap.actors()[0].joints[0]"))
        assert state(browser, "answer") == ("initial" if share < 0.5 else "final")
        halo = browser.value("imocap.actors()[0].halo?.alpha ?? 0")
        assert halo == pytest.approx(1 - share)
    browser.key("h")
    browser.drawn()
    sigma_mm = browser.value("imocap.page.videos[0].sigma[24 * imocap.shown()[0] + 4]")
    assert browser.value("imocap.actors()[0].halo.sizes[4]") == pytest.approx(sigma_mm / 1000)
    browser.key("h")
    for share, name in ((0, "initial"), (2, "final")):
        end = browser.value(f"imocap.pose(0, '{name}', imocap.shown()[0]).joints[0]")
        assert pelvis[share] == pytest.approx(end, abs=0.03)
    half = (np.array(pelvis[0]) + pelvis[2]) / 2
    assert pelvis[1] == pytest.approx(half, abs=0.03)


def test_joints_are_measured(browser: Browser) -> None:
    text = "document.getElementById('measured').textContent"
    names = "imocap.page.model.joints.indexOf('left knee')"
    browser.value(f"imocap.act.measure({{body: 0, joint: {names}}})")
    browser.wait(f"{text}.startsWith('height of left knee')")
    assert "v2: " in browser.value(text)  # the same of every body that is shown
    browser.press("Escape", 27)
    browser.wait("document.getElementById('measured').hidden")


def test_the_scene_is_seen_from_the_front_the_side_and_above(browser: Browser) -> None:
    turns = []
    for name in ("front", "side", "top"):
        browser.value(f"imocap.act.look('{name}')")
        turns.append(browser.value("[imocap.orbit.azimuth, imocap.orbit.elevation]"))
    quarter = (turns[1][0] - turns[0][0]) % (2 * np.pi)
    assert quarter == pytest.approx(np.pi / 2)  # the performer's left
    assert turns[2] == pytest.approx([turns[0][0], 1.5])


def test_a_video_of_another_action_has_no_place(made, browser, page, tmp_path):
    sync = made.refined.sync.model_copy(update={"excluded": ["v2"]})
    other = page_of(made, "two of three", sync=sync)
    assert other.header["videos"][1]["role"] == "another action"
    before, after = tmp_path / "other.html", tmp_path / "again.html"
    before.write_text(other.text, encoding="utf-8")
    after.write_text(page.text, encoding="utf-8")
    browser.open(before)
    browser.wait("window.imocap?.page.title === 'two of three'")
    said = "[...document.querySelectorAll('.card')].map(c => c.querySelector('footer').innerText)"
    browser.wait(f"{said}[1].includes('not synchronised') && {said}[0].includes('match 80 %')")
    browser.key("c")
    browser.key("c")
    assert state(browser, "through") == 2
    browser.open(after)
    browser.wait("window.imocap?.page.title === 'waving'")
