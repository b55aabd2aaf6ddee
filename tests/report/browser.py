"""A headless Chromium over the DevTools protocol's pipe: nothing but the standard library."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import re
import shutil
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)
PATIENCE_S = 60.0
CONTRAST = Path(__file__).with_name("contrast.js")
PAINTED = (  # pixels of the curves that have a colour
    "(() => { const c = document.getElementById('curves'), d = c.getContext('2d')"
    ".getImageData(70, 18, c.width - 80, c.height - 25).data; let n = 0;"
    "for (let i = 0; i < d.length; i += 4)"
    "  n += Math.max(d[i], d[i+1], d[i+2]) - Math.min(d[i], d[i+1], d[i+2]) > 40;"
    "return n; })()"
)


class Browser:
    """One page in a browser of its own; `errors` collects what the page complained of."""

    def __init__(self, profile: Path, width: int = 1280, height: int = 800) -> None:
        self.errors: list[str] = []
        self._next, self._rest = 0, b""
        to_child, self._write = os.pipe()
        self._read, from_child = os.pipe()
        ends = [fcntl.fcntl(fd, fcntl.F_DUPFD, 10) for fd in (to_child, from_child)]

        def at_3_and_4() -> None:
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        self._process = subprocess.Popen(
            [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            preexec_fn=at_3_and_4,  # where the pipe is looked for
            pass_fds=(3, 4),
        )
        for fd in (to_child, from_child, *ends):
            os.close(fd)
        self._session: str | None = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.resize(width, height)

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._session = None
        self._send({"id": 0, "method": "Browser.close"})
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._read)
        os.close(self._write)

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """One command and its result; what happens in between is noted."""
        self._next += 1
        own = self._next
        self._send({"id": own, "method": method, "params": params})
        while True:
            message = self._receive()
            if message.get("id") == own:
                assert "error" not in message, f"{method}: {message['error']}"
                result: dict[str, Any] = message["result"]
                return result
            self._note(message)

    def open(self, file: Path) -> None:
        """Open a local file and wait until its script has run."""
        self.call("Page.navigate", url=file.resolve().as_uri())
        self.wait("document.readyState === 'complete' && location.protocol === 'file:'")

    def visit(self, address: str) -> None:
        """Open an address of a server and wait until its page has been read."""
        self.call("Page.navigate", url=address)
        self.wait(f"document.readyState === 'complete' && location.href === {json.dumps(address)}")

    def value(self, expression: str) -> Any:
        """What a JavaScript expression gives, promises awaited."""
        found = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, expression: str) -> None:
        """Until an expression is true."""
        end = time.monotonic() + PATIENCE_S
        while not self.value(expression):
            assert time.monotonic() < end, f"never came true: {expression}"
            time.sleep(0.05)

    def drawn(self) -> None:
        """Wait until what was asked for has been drawn."""
        self.value("new Promise(r => requestAnimationFrame(() => requestAnimationFrame(r)))")

    def assert_readable(self, **grounds: str) -> None:
        """In each theme, whose ground is named, all texts have a contrast of at least 4.5 (WCAG
        2.2, 1.4.3)."""
        for theme, ground in grounds.items():
            scheme = {"name": "prefers-color-scheme", "value": theme}
            self.call("Emulation.setEmulatedMedia", features=[scheme])
            self.wait(f"getComputedStyle(document.body).backgroundColor === 'rgb({ground})'")
            self.drawn()
            assert self.value(CONTRAST.read_text()) == []

    def assert_named(self, *roles: str) -> None:
        """Screen readers are told a name of everything that has one of the roles."""
        tree = self.call("Accessibility.getFullAXTree")["nodes"]
        nodes = [n for n in tree if n.get("role", {}).get("value") in roles]
        nodes = [n for n in nodes if not n.get("ignored")]
        assert len(nodes) > 25
        assert [n for n in nodes if not n.get("name", {}).get("value")] == []

    def sheets(self) -> int:
        """On how many sheets the page is printed."""
        printed = self.call("Page.printToPDF", preferCSSPageSize=True)["data"]
        return len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(printed)))

    def resize(self, width: int, height: int, density: float = 1.0) -> None:
        """The size of the page's window in CSS pixels."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=density,
            mobile=False,
        )

    def key(self, key: str) -> None:
        """Press and release a key of the keyboard."""
        text = {"text": key} if len(key) == 1 else {}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key)

    def press(self, key: str, code: int, shift: bool = False, control: bool = False) -> None:
        """The same with the effects of a real key (Tab, Enter, ...); `code`: its Windows code."""
        modifiers = 8 * shift + 2 * control
        text = {"text": "\r"} if key == "Enter" else {}
        for kind, extra in (("keyDown", text), ("keyUp", {})):
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code,
                modifiers=modifiers, **extra,
            )  # fmt: skip

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press the left mouse button at one place, and release it at another."""
        places = [start, ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2), end]
        self._mouse("mouseMoved", start)
        self._mouse("mousePressed", start)
        for place in places[1:]:
            self._mouse("mouseMoved", place, buttons=1)
        self._mouse("mouseReleased", end)

    def _mouse(self, kind: str, place: tuple[float, float], buttons: int = 0) -> None:
        x, y = place
        self.call(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1,
            buttons=buttons,
        )  # fmt: skip

    def touch(self, *places: tuple[float, float]) -> None:
        """Put a finger down at the first place, move it along the others, and lift it."""
        for n, (x, y) in enumerate(places):
            kind = "touchStart" if n == 0 else "touchMove"
            self.call("Input.dispatchTouchEvent", type=kind, touchPoints=[{"x": x, "y": y}])
        self.call("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def click(self, x: float, y: float) -> None:
        """Press and release the left mouse button, in CSS pixels."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def screenshot(self, whole: bool = False) -> bytes:
        """The page as PNG; `whole`: also what lies below the window."""
        data = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        return base64.b64decode(data["data"])

    def _send(self, message: dict[str, Any]) -> None:
        if self._session is not None:
            message["sessionId"] = self._session
        data = json.dumps(message).encode() + b"\0"
        while data:
            data = data[os.write(self._write, data) :]

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._read, 1 << 16)
            assert part, "the browser ended"
            self._rest += part
        first, _, self._rest = self._rest.partition(b"\0")
        message: dict[str, Any] = json.loads(first)
        return message

    def _note(self, message: dict[str, Any]) -> None:
        said, params = message.get("method"), message.get("params", {})
        if said == "Runtime.exceptionThrown":
            self.errors.append(str(params["exceptionDetails"]))
        elif said == "Runtime.consoleAPICalled" and params["type"] == "error":
            self.errors.append(" ".join(str(a.get("value", a)) for a in params["args"]))
        elif said == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(params["entry"]["text"])
