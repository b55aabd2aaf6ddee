"""A new action clicked together in a real browser: clicks, drags and seconds, and pictures.

    python -m tools.measure_picking ROOT PICTURES CLIP CLIP CLIP

ROOT: a working folder, in which the action `picked` is made. PICTURES: a folder for pictures of the
page at 1280 x 800 and 390 x 844, light and dark. People are detected by the real detector while the
clicks go on, with a second of thinking before each. Needs a chromium on the PATH.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

from imocap_core.pick.server import picking
from tests.report.browser import Browser

THINKING_S = 1.0
PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}


class Hand:
    """A hand that clicks and drags as a person would, and counts."""

    def __init__(self, browser: Browser, pictures: Path) -> None:
        self.browser, self.pictures = browser, pictures
        self.clicks, self.drags, self.began = 0, 0, time.monotonic()

    def note(self, what: str) -> None:
        print(f"{time.monotonic() - self.began:6.1f} s  {what}", flush=True)

    def place(self, selector: str) -> tuple[float, float]:
        x, y = self.browser.value(
            f"(() => {{ const e = document.querySelector({selector!r});"
            "e.scrollIntoView({block: 'nearest'}); const b = e.getBoundingClientRect();"
            "return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        return x, y

    def click(self, selector: str, what: str) -> None:
        time.sleep(THINKING_S)
        self.browser.wait(f"document.querySelector({selector!r}) !== null")
        self.browser.click(*self.place(selector))
        self.clicks += 1
        self.note(what)

    def drag(self, selector: str, dx: float, what: str) -> None:
        time.sleep(THINKING_S)
        x, y = self.place(selector)
        self.browser.drag((x, y), (x + dx, y))
        self.drags += 1
        self.note(what)

    def picture(self, name: str) -> None:
        """The page as it is, on a desk and on a phone, light and dark."""
        self.browser.value("document.getElementById('toast').classList.remove('shown')")
        for theme in ("light", "dark"):
            scheme = {"name": "prefers-color-scheme", "value": theme}
            self.browser.call("Emulation.setEmulatedMedia", features=[scheme])
            for size in ("desk", "phone"):
                if size == "desk":
                    self.browser.resize(1280, 800)
                else:
                    self.browser.call("Emulation.setDeviceMetricsOverride", **PHONE)
                time.sleep(0.7)
                file = self.pictures / f"{name}_{size}_{theme}.png"
                file.write_bytes(self.browser.screenshot())
        self.browser.resize(1280, 800)
        time.sleep(0.3)


def pick_three(hand: Hand, names: list[str]) -> None:
    """Find people; spans, performers, an anchor and a mirror image; Done."""
    hand.browser.wait("[...document.querySelectorAll('.reading')].every(r => !r.textContent)")
    hand.note("every clip is shown")
    hand.click("#find", "Find people")
    for name in names:
        card = f'.video[aria-label="Video {name}"]'
        hand.drag(f"{card} .grip.first", 40, f"{name} begins later")
        hand.drag(f"{card} .grip.last", -60, f"{name} ends earlier")
    for name in names[:2]:
        card = f'.video[aria-label="Video {name}"]'
        hand.click(f"{card} .moment", f"a moment of {name}")
        hand.click("#mark", f"marked in {name}")
    hand.click("#save-anchor", "they are the same moment")
    for name in names:
        card = f'.video[aria-label="Video {name}"]'
        hand.browser.wait(
            f"document.querySelector({card + ' .state'!r}).textContent.includes('person')"
        )
        hand.note(f"{name} is outlined")
        hand.click(f"{card} .moment", f"a moment of {name}")
        hand.click('#outlines .person[data-number="1"] .body', f"the performer of {name}")
    hand.browser.wait("document.querySelectorAll('.video .state.good').length >= 3")


def main() -> None:
    root, pictures, *clips = (Path(word) for word in sys.argv[1:])
    pictures.mkdir(parents=True, exist_ok=True)
    with (
        picking("picked", clips, root) as served,
        Browser(pictures / "profile", 1280, 800) as browser,
    ):
        hand = Hand(browser, pictures)
        browser.visit(served.address)
        browser.wait("document.querySelectorAll('.video').length > 0")
        names = browser.value("[...document.querySelectorAll('.video h3')].map(h => h.textContent)")
        pick_three(hand, names)
        took = time.monotonic() - hand.began
        browser.click(*hand.place(f'.video[aria-label="Video {names[0]}"] h3 button'))
        hand.picture("page")
        hand.click("#done", "Done")
        print(f"{hand.clicks} clicks and {hand.drags} drags in {took + 1:.0f} s")
        print((root / "actions" / "picked" / "action.yaml").read_text())
        assert browser.errors == [], browser.errors


if __name__ == "__main__":
    main()
