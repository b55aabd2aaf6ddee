"""The viewer's page: whole in itself, exact enough, and true to the artifacts."""

import io
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
import torch

from imocap_core import rotations
from imocap_core.artifacts.schemas import CameraMotion, Sync
from imocap_core.body import load_free_body
from imocap_core.diagnostics.findings import Finding, Verdict
from imocap_core.figures.sheets import surfaces
from imocap_core.io.video import encode_webm
from imocap_core.viewer import viewer_scene
from imocap_core.viewer.html import Block, quantised, strongest_bones
from imocap_core.viewer.viewer_scene import contact_spans
from imocap_core.viewer.viewer_video import (
    UNKNOWN_MM,
    first_shared,
    phase_of,
    stride,
    uncertainty_entry,
    windows,
)
from tests.report.made import K, Made
from tests.report.viewed import Page, inflated, page_of, read_entry, write_clip


@pytest.fixture(scope="module")
def page(made: Made) -> Page:
    return page_of(made)


def entries(value: Any) -> list[dict[str, Any]]:
    if isinstance(value, dict) and "$" in value:
        return [value]
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return [found for part in parts for found in entries(part)]


def skinned(page: Page, video: int, answer: str) -> np.ndarray:
    """Vertices (T, V, 3) in the level world, as web/body.js and web/shaders.js make them."""
    model, own = page.header["model"], page.header["videos"][video]["answers"][answer]
    shape, parents = page.header["shapes"][own["shape"]], model["parents"]
    rest = page.array(shape["rest"], -1, 3) / 32767 * shape["scale"]
    joints_rest = page.array(shape["joints"], -1, 3).astype(np.float64)
    local = page.array(own["local"], -1, len(parents), 3).astype(np.float64)
    R_local = rotations.exp(torch.from_numpy(local)).numpy()
    R, joints = [R_local[:, 0]], [joints_rest[0] + page.array(own["trans"], -1, 3)]
    for j, parent in enumerate(parents[1:], start=1):
        R.append(R[parent] @ R_local[:, j])
        bone = joints_rest[j] - joints_rest[parent]
        joints.append(joints[parent] + R[parent] @ bone)
    bones = page.array(model["bones"], -1, 4)
    weights = page.array(model["weights"], -1, 4) / 65535
    vertices = np.zeros((len(local), len(rest), 3))
    for k in range(4):
        for j in np.unique(bones[:, k]):
            at = bones[:, k] == j
            carried = (rest[at] - joints_rest[j]) @ R[j].transpose(0, 2, 1) + joints[j][:, None]
            vertices[:, at] += weights[at, k, None] * carried
    return vertices


def test_the_page_needs_nothing_but_itself(page: Page) -> None:
    class Seen(HTMLParser):
        asked: list[str] = []  # noqa: RUF012
        ids: list[str] = []  # noqa: RUF012

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            given = dict(attrs)
            Seen.asked += [str(given[a]) for a in ("src", "href", "data", "action") if a in given]
            Seen.ids += [str(given["id"])] if "id" in given else []

    Seen().feed(page.text)
    assert Seen.asked == []
    assert len(Seen.ids) == len(set(Seen.ids))
    script = re.search(r"<script>(.*?)</script>", page.text, re.S)
    assert not re.search(r"https?://|\bimport\b|fetch\(|XMLHttpRequest|url\(", script[1])
    wanted = set(re.findall(r'\$\("(\w+)"\)', script[1]))
    assert wanted <= set(Seen.ids)
    assert not re.search(r"\$\w", page.text.split("<script>")[0]), "a place left open"


def test_every_entry_lies_within_the_data(page: Page) -> None:
    found = entries(page.header)
    sizes = [int(e["$"][1]) * e["count"] for e in found]
    assert all(e["at"] % int(e["$"][1]) == 0 for e in found)
    ends = [e["at"] + size for e, size in zip(found, sizes, strict=True)]
    assert max(ends) == len(page.data)


def test_no_name_can_end_the_page_s_elements(made: Made) -> None:
    name = "</script><script>alert(1)</script>&"
    page = page_of(made, name)
    assert page.header["title"] == name
    assert page.text.count("</script>") == 3
    assert "alert(1)</script>" not in page.text


@pytest.mark.parametrize("answer", ["initial", "final"])
@pytest.mark.parametrize("video", [0, 2])
def test_skinned_from_the_page_the_surface_is_the_body_s(page, made, video, answer):
    motion = {"initial": made.bent, "final": made.final}[answer][video]
    frames = [0, 7, 15]
    own = surfaces(made.model, motion, frames)
    shown = skinned(page, video, answer)[frames]
    # The page has a level world: compare what does not depend on the axes, all distances.
    some = np.linspace(0, own.shape[1] - 1, 40).astype(int)

    def apart(x: np.ndarray) -> np.ndarray:
        return np.linalg.norm(x[:, some, None] - x[:, None, some], axis=-1)

    assert np.abs(apart(own) - apart(shown)).max() < 1e-4
    centre = page.header["videos"][video]["camera"]["centre"]
    distance = np.linalg.norm(own, axis=-1) - np.linalg.norm(shown - centre, axis=-1)
    assert np.abs(distance).max() < 1e-4


def test_hands_move_the_fingers_of_the_final_answer_alone(made: Made) -> None:
    page = page_of(made, hands=True)
    assert len(page.header["model"]["parents"]) == 52
    local = {
        answer: page.array(page.header["videos"][1]["answers"][answer]["local"], -1, 52, 3)
        for answer in ("initial", "final")
    }
    assert np.abs(local["final"][:, 22:]).max() > 0.5
    assert np.abs(local["initial"][:, 22:]).max() < 1e-6


@pytest.mark.parametrize("zoom", [1.0, 1.5])
def test_the_shown_camera_sees_what_was_projected(made: Made, zoom: float) -> None:
    by_frame = np.linspace(1.0, zoom, 16)
    videos = [v.model_copy(update={"zoom": by_frame}) for v in made.camera_motion.videos]
    page = page_of(made, camera_motion=CameraMotion(videos=videos))
    own = page.header["videos"][1]
    answer, shape = own["answers"]["final"], page.header["shapes"][0]
    pelvis = page.array(answer["trans"], -1, 3) + page.array(shape["joints"], -1, 3)[0]
    axes = page.array(own["camera"]["axes"], -1, 3, 3)[0]
    x = (pelvis - own["camera"]["centre"]) @ axes  # R_world_from_cam^T
    lens = own["camera"]
    seen = page.array(lens["zoom"], -1, 1) * [lens["fx"], lens["fy"]] * x[:, :2] / x[:, 2:]
    xy = seen + [lens["cx"], lens["cy"]]
    final = own["projected"]["final"]
    drawn = page.array(final["xy"], -1, final["count"], 2)[:, 0] / final["unit"]
    np.testing.assert_allclose(drawn, xy, atol=0.05)
    true = made.final[1].joints[:, 0] @ K.T
    still = true[:, :2] / true[:, 2:] - K[:2, 2]
    np.testing.assert_allclose(xy, by_frame[:, None] * still + K[:2, 2], atol=1e-3)


def test_everyone_stands_on_the_ground(page: Page) -> None:
    lowest = [skinned(page, v, "final")[..., 1].min() for v in range(3)]
    assert max(np.abs(lowest)) < 0.15
    assert all(max(p[1] for p in box) > 1.4 for box in page.header["bounds"])


def test_phases_never_fall_and_agree_with_the_matches(made: Made) -> None:
    sync = made.refined.sync
    for v in range(3):
        phase = phase_of(sync, made.keypoints, v)
        assert (np.diff(phase) >= 0).all()
        matched = np.isfinite(sync.maps[v].reference_frame)
        np.testing.assert_allclose(
            phase[matched], sync.maps[v].reference_frame[matched] / 30.0, atol=1e-9
        )
    steps = np.diff(phase_of(sync, made.keypoints, 2)[-4:])
    np.testing.assert_allclose(steps, 1 / 30, atol=1e-9)  # unmatched: at its own pace


def test_the_first_shared_moment() -> None:
    spans = [np.array([0.0, 2.0]), np.array([-0.5, 1.0]), np.array([0.3, 0.9])]
    assert first_shared(spans, -0.5) == 0.3
    assert first_shared([*spans, np.array([5.0, 6.0])], -0.5) == 0.3  # that most videos show
    assert first_shared([], -0.5) == -0.5


def test_uncertainty_comes_back_in_millimetres(page: Page, made: Made) -> None:
    sigma = page.array(page.header["videos"][2]["sigma"], -1, 24)
    np.testing.assert_allclose(sigma, made.claimed.videos[2].sigma_mm, atol=0.5)


def test_an_unknown_uncertainty_is_not_shown_as_certain(made: Made) -> None:
    sigma_mm = made.claimed.videos[0].sigma_mm.copy()
    sigma_mm[0, :3] = np.nan, np.inf, 1e9
    videos = [made.claimed.videos[0].model_copy(update={"sigma_mm": sigma_mm})]
    block = Block()
    entry = uncertainty_entry(
        block, made.claimed.model_copy(update={"videos": videos}), videos[0].id
    )
    shown = read_entry(entry, inflated(block.base64()))
    assert list(shown[:3]) == [UNKNOWN_MM, UNKNOWN_MM - 1, UNKNOWN_MM - 1]


def test_a_video_without_any_match_begins_at_nought(made: Made) -> None:
    sync = made.refined.sync
    blind = sync.maps[1].model_copy(update={"reference_frame": np.full(16, np.nan)})
    lost = Sync.model_validate(
        {**dict(sync), "maps": [sync.maps[0], blind, sync.maps[2]], "excluded": ["v2"]}
    )
    assert phase_of(lost, made.keypoints, 1)[0] == 0.0


def test_pictures_are_those_of_the_used_frames(made: Made, tmp_path: Path) -> None:
    page = page_of(made, files={"v2": write_clip(tmp_path / "v2.mp4", 18)})
    assert [v["pictures"] is None for v in page.header["videos"]] == [True, False, True]
    film = page.header["videos"][1]["pictures"]
    data, keys = page.array(film["bytes"], -1).tobytes(), page.array(film["keys"], -1)
    packets = page.array(film["packets"], -1, 2)
    with av.open(io.BytesIO(data)) as container:
        light = [frame.to_ndarray(format="gray").mean() for frame in container.decode(video=0)]
        container.seek(0)
        parts = [bytes(p) for p in container.demux(video=0) if p.size]
    # of limited range, in which 16 is black and 235 is white
    np.testing.assert_allclose(light, 40 + 8 * made.frames[1], atol=4)
    assert [data[start : start + size] for start, size in packets] == parts
    assert keys.tolist() == [1, *[0] * (len(parts) - 1)]


def test_a_stream_of_pictures_is_the_same_each_time_and_sets_out_anew_at_key_pictures() -> None:
    rng = np.random.default_rng(3)
    pictures = rng.integers(0, 255, (9, 33, 41, 3)).astype(np.uint8)
    streams = [encode_webm(pictures, crf=40, key_every=4) for _ in range(2)]
    assert streams[0] == streams[1]
    assert streams[0].size == (40, 32)
    assert streams[0].keys == [n % 4 == 0 for n in range(9)]
    with pytest.raises(ValueError, match="expected at least one, got none"):
        encode_webm([], crf=40, key_every=4)


def test_windows_hold_every_box_and_lie_in_the_picture() -> None:
    rng = np.random.default_rng(4)
    sizes = [(640, 360), (1080, 1920), (500, 500)]
    boxes = []
    for width, height in sizes:
        low = rng.uniform(0, 0.5, (30, 2)) * [width, height]
        boxes.append(np.concatenate([low, low + 0.3 * np.array([width, height])], axis=1))
    boxes[0][4] = np.nan
    for (x, y, w, h), own, (width, height) in zip(windows(boxes, sizes), boxes, sizes, strict=True):
        assert 0 <= x <= x + w <= width
        assert 0 <= y <= y + h <= height
        assert x <= np.nanmin(own[:, 0])
        assert x + w >= min(np.nanmax(own[:, 2]), width)
        assert y + h >= min(np.nanmax(own[:, 3]), height)
    assert windows([np.full((3, 4), np.nan)], [(640, 360)]) == [(0, 0, 640, 360)]


def test_of_long_videos_every_second_frame_is_shown() -> None:
    assert stride([200, 300]) == 1
    assert stride([]) == 1
    assert sum(-(-n // stride([900, 900])) for n in (900, 900)) <= 1000


def test_numbers_come_back_from_the_block() -> None:
    block, rng = Block(), np.random.default_rng(1)
    given = {k: rng.integers(0, 100, 7) for k in ("u1", "i2", "u2", "i4", "u4")}
    given["f4"] = rng.standard_normal(5)
    kept = {kind: block.add(values, kind) for kind, values in given.items()}
    data = inflated(block.base64())
    for kind, values in given.items():
        np.testing.assert_allclose(read_entry(kept[kind], data), values, rtol=1e-6)
    with pytest.raises(ValueError, match="from 0 to 255 for u1, got -1 to 300"):
        block.add([-1, 300], "u1")


def test_quantised_numbers_err_by_half_a_step_at_most() -> None:
    values = np.random.default_rng(2).uniform(-1.2, 1.2, 1000)
    whole, scale = quantised(values)
    assert np.abs(whole / 32767 * scale - values).max() <= scale / 65534 * (1 + 1e-9)
    with pytest.raises(ValueError, match="finite"):
        quantised([1.0, np.nan])


def test_weights_sum_to_one_exactly() -> None:
    given = load_free_body(hands=True).weights.numpy()
    bones, weights = strongest_bones(given)
    assert (weights.sum(axis=1) == 65535).all()
    assert weights.min() >= 0
    dense = np.zeros_like(given)
    np.put_along_axis(dense, bones, weights / 65535, axis=1)
    assert np.abs(dense - given).max() < 3e-5


def test_contacts_are_on_the_common_axis() -> None:
    phase = np.array([0.5, 0.6, 0.6, 0.9, 1.3])
    spans = contact_spans({"left": [(0, 2), (4, 4)], "right": []}, phase)
    assert spans == {"left": [[0.5, 0.6], [1.3, 1.3]], "right": []}


def test_findings_have_their_place_on_the_common_axis(made, monkeypatch):
    verdict = Verdict(
        ("Doubtful.",),
        (
            Finding("time", "v2", "the time stands still", "stands still", "", 3, 6),
            Finding("view", "", "depth is a guess", "depth is a guess"),
        ),
    )
    monkeypatch.setattr(viewer_scene, "verdict_of_artifacts", lambda artifacts: verdict)
    shown = page_of(made)
    entry = shown.header["verdict"]
    phase = shown.array(shown.header["videos"][1]["phase"], -1)
    assert entry["level"] == "check"
    spans = [(f["video"], f["first"], f["last"]) for f in entry["findings"]]
    first, last = np.searchsorted(shown.array(shown.header["videos"][1]["frames"], -1), [3, 6])
    assert spans == [(1, pytest.approx(phase[first]), pytest.approx(phase[last])), (-1, None, None)]
