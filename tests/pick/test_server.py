"""The page's requests over real HTTP: what it shows, and what it makes of action.yaml; who may
ask the server, and for what."""

import json
import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from imocap_core.body.layouts import layout_names
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pick.media import outline
from imocap_core.pick.server import MOST_BYTES, open_session, picking
from tests.pick.conftest import CUT, FRAMES, SIZE, working_folder
from tests.pick.made import Asker
from tests.stages.test_people import PERFORMER, tracked

# Outlines enclose the person: every joint lies in the polygon, and little else does.
COCO = layout_names("coco17")


@pytest.mark.parametrize("frame", [0, 17, 31])
@pytest.mark.parametrize("scale", [1.0, 0.05])
def test_every_joint_is_inside(frame: int, scale: float) -> None:
    pose = PERFORMER[frame] * (scale, scale, 1)
    polygon = outline(pose, COCO).astype(np.float32)
    size = float(np.hypot(*np.ptp(pose[:, :2], axis=0)))
    for x, y, _ in pose:
        assert cv2.pointPolygonTest(polygon, (float(x), float(y)), True) > -0.03 * size
    assert cv2.contourArea(polygon) < 0.8 * np.prod(np.ptp(polygon, axis=0))


def test_joints_that_are_missing_leave_one_polygon() -> None:
    pose = PERFORMER[5].copy()
    pose[[5, 6, 7, 11], 2] = 0  # shoulders, an elbow, a hip
    polygon = outline(pose, COCO).astype(np.float32)
    for x, y in pose[pose[:, 2] > 0, :2]:
        assert cv2.pointPolygonTest(polygon, (float(x), float(y)), True) > -12


def test_frames_are_those_of_the_file() -> None:
    from dataclasses import replace

    from imocap_core.pick.media import outlines_of

    video = tracked("v1", PERFORMER)
    late = outlines_of(replace(video, frames=video.frames + 100))
    (person,) = late["people"]
    assert late["frames"] == [100, 160]
    assert person["frames"][0] == 100
    assert len(person["boxes"][0]) == 4
    assert len(person["outlines"]) == len(person["frames"])


def test_the_state_shows_videos_people_and_what_would_run(asker: Asker) -> None:
    state = asker.wait(
        lambda s: s["plan"] and {v["people"]["state"] for v in s["videos"]} == {"ready"}
    )
    first, second = state["files"]
    assert (first["count"], tuple(first["size"]), first["cuts"]) == (FRAMES, SIZE, [CUT])
    assert second["cuts"] == []
    assert state["plan"]["stages"][0]["stage"] == "keypoints"
    assert state["plan"]["stages"][0]["why"] == ["never run"]
    assert state["warnings"] == []
    assert state["fault"] is None
    assert state["file"] == "actions/made/action.yaml"
    assert state["command"].endswith("run made")
    answer, content = asker.ask(f"people/{state['videos'][0]['people']['key']}")
    assert answer.status == 200
    everybody = json.loads(content)["people"]
    assert [person["number"] for person in everybody] == [1, 2]
    assert everybody[0]["frames"] == list(range(FRAMES))
    x0, _, x1, _ = everybody[0]["boxes"][10]
    assert x0 < 60 + 3 * 10 < x1


@pytest.mark.parametrize(("kind", "width"), [("thumb", 160), ("large", 320)])
def test_pictures_are_of_their_frames(asker: Asker, kind: str, width: int) -> None:
    asker.wait(lambda s: "count" in s["files"][0])
    shown = {}
    for number in (30, 2, 20, 19, 18):
        answer, content = asker.ask(f"pictures/0/{kind}/{number}.jpg")
        assert answer.getheader("Content-Type") == "image/jpeg"
        shown[number] = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
        assert shown[number].shape[1] == width
        place = int((60 + 3 * number) * width / SIZE[0])
        blue, _, red = shown[number][shown[number].shape[0] // 2, place].astype(int)
        assert red > blue + 60, "the walking figure is here"


def test_an_edit_is_written_and_undone(asker: Asker) -> None:
    asker.wait(lambda s: "count" in s["files"][0])
    before = asker.file.read_text()
    person = {"frame": 12, "box": [80, 20, 120, 150]}
    status, state = asker.edit(
        {"kind": "person", "video": "v1", "person": person},
        {"kind": "frames", "video": "v1", "frames": [2, CUT]},
    )
    assert status == 200
    assert state["videos"][0]["person"] == person
    assert state["videos"][0]["frames"] == [2, CUT]
    assert state["can_undo"]
    text = asker.file.read_text()
    assert "# first" in text
    assert "# made for a test" in text
    _, content = asker.ask("step", {"revision": state["revision"], "step": "undo"})
    assert asker.file.read_text() == before
    state = json.loads(content)
    assert not state["can_undo"]
    asker.ask("step", {"revision": state["revision"], "step": "redo"})
    assert asker.file.read_text() == text


def test_a_faulty_edit_is_told_in_plain_words(asker: Asker) -> None:
    asker.wait(lambda s: "count" in s["files"][0])
    before = asker.file.read_text()
    status, document = asker.edit({"kind": "frames", "video": "v1", "frames": [30, 20]})
    assert status == 422
    assert document["error"] == (
        "action.yaml: videos.0: frames: expected [first, one past last], got [30, 20]"
    )
    status, document = asker.edit({"kind": "frames", "video": "v1", "frames": [0, 999]})
    assert status == 422
    assert f"within [0, {FRAMES}]" in document["error"]
    assert asker.file.read_text() == before


def test_a_change_of_another_program_is_noticed(asker: Asker) -> None:
    old = asker.state()["revision"]
    asker.file.write_text(asker.file.read_text() + "# by hand\n")
    status, document = asker.edit(
        {"kind": "mirrored", "video": "v1", "mirrored": True}, revision=old
    )
    assert status == 409
    assert "changed by another program" in document["error"]
    assert asker.file.read_text().endswith("# by hand\n")
    assert asker.state()["revision"] != old
    assert asker.edit({"kind": "mirrored", "video": "v1", "mirrored": True})[0] == 200
    assert asker.file.read_text().endswith("# by hand\n")


def test_a_file_that_became_faulty_is_shown_with_its_fault(asker: Asker) -> None:
    text = asker.file.read_text()
    asker.file.write_text(text.replace("id: v2", "id: v1"))
    state = asker.state()
    assert state["fault"] == "action.yaml: (whole file): videos: expected unique ids, got v1 twice"
    assert [video["id"] for video in state["videos"]] == ["v1", "v2"]
    asker.file.write_text(text)
    assert asker.state()["fault"] is None


def test_several_entries_of_one_file_share_its_pictures(asker: Asker) -> None:
    asker.wait(lambda s: "count" in s["files"][0])
    _, state = asker.edit({"kind": "split", "video": "v1", "starts": [CUT]})
    assert [video["id"] for video in state["videos"]] == ["v1", "v1_2", "v2"]
    assert [video["file"] for video in state["videos"]] == [0, 0, 1]
    assert len(state["files"]) == 2
    assert state["videos"][1]["frames"] == [CUT, FRAMES]


def test_what_a_run_would_refuse_is_a_warning(asker: Asker) -> None:
    asker.wait(lambda s: all("count" in f for f in s["files"]))
    _, state = asker.edit(
        {"kind": "add_anchor", "frames": {"v1": 30, "v2": 31}},
        {"kind": "person", "video": "v1", "person": {"frame": 35, "at": [100, 90]}},
        {"kind": "frames", "video": "v1", "frames": [2, CUT]},
    )
    assert len(state["warnings"]) == 2
    assert "The performer of v1 is named in frame 35, which is not used" in state["warnings"][0]
    assert "Anchor 1 is on frame 30 of v1, which is not used" in state["warnings"][1]


def test_a_video_that_is_none_is_named(root: Path) -> None:
    (root / "actions" / "made" / "v2.mp4").write_text("no video")
    with picking("made", [], root) as served:
        asker = Asker(served, root / "actions" / "made" / "action.yaml")
        state = asker.wait(lambda s: "fault" in s["files"][1] and "count" in s["files"][0])
        assert "is not a readable video" in state["files"][1]["fault"]
        assert asker.ask("pictures/1/thumb/0.jpg")[0].status == 404


def test_detection_that_cannot_begin_says_why(asker, monkeypatch):
    def refused(*_: object, **__: object) -> None:
        raise WorkFailed("the detector's environment needs the network once")

    monkeypatch.setattr("imocap_core.pick.session.detect", refused)
    assert asker.ask("detect", {})[0].status == 200
    state = asker.wait(lambda s: s["detection"]["state"] == "failed")
    assert "needs the network once" in state["detection"]["text"]


def test_done_ends_it(asker: Asker) -> None:
    assert asker.ask("done", {})[0].status == 200
    assert asker.served.done.is_set()


def test_a_new_action_is_made_as_by_init(tmp_path: Path, films: Path) -> None:
    session, remarks = open_session("fresh", [films / "v1.mp4", films / "v2.mp4"], tmp_path)
    session.close()
    assert "Wrote" in remarks[-1]
    data = yaml.safe_load((tmp_path / "actions" / "fresh" / "action.yaml").read_text())
    assert [video["id"] for video in data["videos"]] == ["v1", "v2"]
    assert {video["keypoints"] for video in data["videos"]} == {"detect"}
    open_session("fresh", [films / "v1.mp4", films / "v2.mp4"], tmp_path)[0].close()
    with pytest.raises(WrongUse, match="of other videos"):
        open_session("fresh", [films / "v1.mp4"], tmp_path)


def test_an_action_that_is_not_there_or_wrong_is_a_sentence(root: Path) -> None:
    with pytest.raises(WrongUse, match="no action 'other'"):
        open_session("other", [], root)
    (root / "actions" / "made" / "action.yaml").write_text("name: 3\n")
    with pytest.raises(WorkFailed, match="videos: is missing"):
        open_session("made", [], root)


def test_a_port_that_is_taken_is_a_sentence(root: Path, asker: Asker) -> None:
    with (
        pytest.raises(WorkFailed, match=f"cannot listen on 127.0.0.1:{asker.port}"),
        picking("made", [], root, asker.port),
    ):
        pass


MIRROR = {"kind": "mirrored", "video": "v1", "mirrored": True}


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory, films: Path) -> Iterator[Asker]:
    """One page for all: what is refused changes nothing."""
    root = working_folder(tmp_path_factory.mktemp("guarded"), films)
    with picking("made", [], root) as served:
        guarded = Asker(served, root / "actions" / "made" / "action.yaml")
        guarded.wait(lambda s: s["plan"] and all("count" in f for f in s["files"]))
        yield guarded
    files = {p.name for p in (root / "actions" / "made").iterdir()}
    assert files == {"action.yaml", "v1", "v2", "v1.mp4", "v2.mp4"}


def test_the_page_comes_with_its_protection(guarded: Asker) -> None:
    answer, content = guarded.ask("")
    assert answer.status == 200
    assert b"<!doctype html>" in content
    policy = str(answer.getheader("Content-Security-Policy"))
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert "http" not in policy
    assert answer.getheader("Referrer-Policy") == "no-referrer"
    assert answer.getheader("X-Content-Type-Options") == "nosniff"
    assert b"://" not in content.replace(b"http://www.w3.org", b"")


@pytest.mark.parametrize("token", ["", "x", "state", "..", "%2e%2e"])
def test_without_the_token_there_is_nothing(guarded: Asker, token: str) -> None:
    for path in ("", "state", "page/main.js", "pictures/0/thumb/0.jpg"):
        answer, content = guarded.ask(path, token=token)
        assert answer.status == 403
        assert b"whole address" in content
    for near in (guarded.token[:-1], guarded.token + "x", guarded.token.swapcase()):
        assert guarded.ask("state", token=near)[0].status == 403


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1", "", None])
def test_another_host_is_refused(guarded: Asker, host: str | None) -> None:
    named = None if host is None else host.format(port=guarded.port)
    assert guarded.ask("state", Host=named)[0].status == 403


def test_localhost_is_this_machine(guarded: Asker) -> None:
    assert guarded.ask("state", Host=f"localhost:{guarded.port}")[0].status == 200


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": None}, 403),
        ({"Origin": "https://127.0.0.1:{port}"}, 403),
        ({"Sec_Fetch_Site": "cross-site"}, 403),
        ({"Content_Type": "text/plain"}, 415),
        ({"Content_Type": "application/x-www-form-urlencoded"}, 415),
        ({"Content_Length": None}, 411),
        ({"Content_Length": "-5"}, 411),
        ({"Content_Length": str(MOST_BYTES + 1)}, 413),
    ],
)
def test_changes_come_from_the_page_alone(guarded, headers, status):
    before = guarded.file.read_bytes()
    sent = {k: v and v.format(port=guarded.port) for k, v in headers.items()}
    body = {"revision": guarded.state()["revision"], "edits": [MIRROR]}
    for path in ("edit", "step", "detect", "done"):
        assert guarded.ask(path, body, **sent)[0].status == status
    assert guarded.file.read_bytes() == before
    assert not guarded.served.done.is_set()


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "PATCH", "TRACE"])
def test_other_methods_are_refused(guarded: Asker, method: str) -> None:
    assert guarded.ask("state", method=method)[0].status == 405


@pytest.mark.parametrize(
    "path",
    [
        "page/../action.yaml",
        "page/..%2f..%2froutes.py",
        "page/%2fetc%2fpasswd",
        "page/__init__.py",
        "pictures/0/thumb/..%2f..%2f0.jpg",
        "pictures/99/thumb/0.jpg",
        "pictures/0/thumb/4000.jpg",
        "pictures/-1/thumb/0.jpg",
        "pictures/0/whole/0.jpg",
        "people/0123",
        "people/..%2f..%2faction.yaml",
        "actions/made/v1.mp4",
        "%00",
    ],
)
def test_nothing_is_read_by_its_path(guarded: Asker, path: str) -> None:
    answer, content = guarded.ask(path)
    assert answer.status == 404
    assert content == b'{"error": "there is nothing here"}'


@pytest.mark.parametrize(
    "body", [b"{", b"\xff\xfe", b"[" * 5000, b'"x"', b"{}", b'{"revision": 1, "edits": []}']
)
def test_nonsense_is_answered_with_a_sentence(guarded: Asker, body: bytes) -> None:
    before = guarded.file.read_bytes()
    for path in ("edit", "step"):
        answer, content = guarded.ask(path, body)
        assert answer.status == 422
        assert b"Traceback" not in content
    assert guarded.file.read_bytes() == before


def test_a_length_without_end_and_a_short_body(guarded: Asker) -> None:
    answer, content = guarded.ask("edit", b"{}", Content_Length=5000 * "9")
    assert (answer.status, b"Traceback" in content) == (413, False)
    head = (
        f"POST /{guarded.token}/edit HTTP/1.1\r\nHost: {guarded.host}\r\nOrigin: http://{guarded.host}\r\n"
        "Content-Type: application/json\r\nContent-Length: 50\r\n\r\n{"
    )
    answered = guarded.raw(head.encode())
    assert b"422" in answered.partition(b"\r\n")[0]
    assert b"the request broke off: 1 of its 50 bytes came" in answered


def test_requests_that_are_no_http_break_nothing(guarded: Asker) -> None:
    for text in (b"", b"\x16\x03\x01\x00", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n"):
        answer = guarded.raw(text)
        assert b"Traceback" not in answer
        assert b"site-packages" not in answer
    long = b"GET /" + b"a" * 70_000 + b" HTTP/1.1\r\n\r\n"
    assert b" 414 " in guarded.raw(long)
    assert guarded.state()["action"] == "made"


def test_a_fault_of_the_program_shows_no_traceback(root, monkeypatch):
    faults: list[str] = []
    with picking("made", [], root, fault=faults.append) as served:
        guarded = Asker(served, root)
        monkeypatch.setattr("imocap_core.pick.session.warnings_of", lambda *_: 1 / 0)
        answer, content = guarded.ask("state")
    assert answer.status == 500
    assert content == b"imocap: a fault of the program\n"
    assert "ZeroDivisionError" in faults[0]


def test_other_machines_cannot_reach_it(guarded: Asker) -> None:
    names = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for address in names - {"127.0.0.1"} | {"127.0.0.2"}:
        with closing(socket.socket()) as connection:
            connection.settimeout(5)
            assert connection.connect_ex((address, guarded.port)) != 0


def test_every_page_has_an_address_of_its_own(root: Path, guarded: Asker) -> None:
    with picking("made", [], root) as other:
        assert Asker(other, root).token != guarded.token
        assert len(guarded.token) >= 32
        assert guarded.ask("state", token=Asker(other, root).token)[0].status == 403
