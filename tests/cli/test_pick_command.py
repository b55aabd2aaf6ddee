"""`imocap pick` prints the page's address, serves it until Done, and says what comes next."""

from __future__ import annotations

import http.client
import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from imocap_core.cli import main
from imocap_core.io.video import write_h264
from tests.pick.conftest import picture


def press_done(address: str) -> None:
    parts = urlsplit(address)
    connection = http.client.HTTPConnection(parts.netloc, timeout=30)
    headers = {"Origin": f"http://{parts.netloc}", "Content-Type": "application/json"}
    connection.request("POST", f"{parts.path}done", json.dumps({}), headers)
    assert connection.getresponse().status == 200
    connection.close()


def test_a_new_action_is_served_until_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    videos = [tmp_path / f"{name}.mp4" for name in ("a", "b")]
    for video in videos:
        write_h264(video, [picture(t, 0, False) for t in range(5)], 20.0)
    opened: list[str] = []

    def open_in_browser(address: str) -> bool:
        opened.append(address)
        threading.Thread(target=press_done, args=(address,)).start()
        return True

    monkeypatch.setattr("webbrowser.open", open_in_browser)
    monkeypatch.setenv("BROWSER", "one")
    monkeypatch.setattr("sys.argv", ["imocap"])
    code = main(["--root", str(tmp_path), "pick", "made", *map(str, videos)])
    shown = capsys.readouterr()
    assert code == 0, shown.err
    assert f"Pick at {opened[0]}" in shown.out
    assert opened[0].startswith("http://127.0.0.1:")
    assert shown.out.rstrip().endswith("Next: imocap run made")
    assert (tmp_path / "actions" / "made" / "action.yaml").is_file()


def test_an_action_that_does_not_exist_is_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["imocap"])
    assert main(["--root", str(tmp_path), "pick", "nowhere", "--no-open"]) == 2
    assert "no action 'nowhere'" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_ends_it_as_done_does(tmp_path: Path) -> None:
    write_h264(tmp_path / "a.mp4", [picture(t, 0, False) for t in range(5)], 20.0)
    line = [sys.executable, "-c", "from imocap_core.cli import main; raise SystemExit(main())"]
    words = ["--root", str(tmp_path), "pick", "made", str(tmp_path / "a.mp4"), "--no-open"]
    with subprocess.Popen([*line, *words], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        while not process.stdout.readline().startswith("Pick at http://127.0.0.1:"):
            pass
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read()
    assert process.returncode == 0
    assert "Next: imocap run made" in rest
