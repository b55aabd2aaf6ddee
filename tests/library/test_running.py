"""run, load, synchronise and what they say: the same sentences as the command line's, as
exceptions."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import imocap
from imocap_core.cli import main
from imocap_core.cli.options import plain
from imocap_core.errors import WrongUse
from imocap_core.library import new_action
from imocap_core.library.api_errors import one_off
from imocap_core.library.run_document import run_document
from imocap_core.library.running import run_action
from imocap_core.pipeline.action import read_action
from imocap_core.report.first_page import compared, expected_error_mm, moved_mm
from tests.io.made_videos import write_video
from tests.library.conftest import SmallRun
from tests.report.made import FPS, SIZE
from tools.chaos.run import vary_threads
from tools.chaos.small_action import SmallAction, quick


def test_a_run_reports_every_stage(small_run: SmallRun) -> None:
    stages = ["keypoints", "camera_motion", "initial_smpl", "sync", "smpl_ba", "redetect"]
    stages += ["refine_sync"]
    made = [stage for stage, share, what in small_run.reports if (share, what) == (1.0, "made")]
    assert made[:7] == stages
    assert all(0 <= share <= 1 for _, share, _ in small_run.reports)


def test_load_gives_what_run_gave(small_run: SmallRun) -> None:
    loaded = imocap.load(small_run.root / "artifacts" / "serve")
    assert loaded.ids == small_run.result.ids == ("v1", "v2")
    for one, two in zip(loaded, small_run.result, strict=True):
        np.testing.assert_array_equal(one.joints, two.joints)
        np.testing.assert_array_equal(one.uncertainty, two.uncertainty)
        assert one.video == two.video
        assert one.video.is_file()
    before = imocap.load(small_run.root / "artifacts" / "serve", stage="smpl_ba")
    assert before["v1"].joints.shape == loaded["v1"].joints.shape


def test_until_stops_early_params_hold_for_one_run_and_progress_is_shown_as_by_the_command(
    small_run, capsys
):
    again = imocap.run("serve", root=small_run.root, until="smpl_ba", progress=None)
    assert capsys.readouterr() == ("", "")
    assert again["v1"].uncertainty is None
    other = imocap.run(
        "serve", root=small_run.root, until="smpl_ba", params={"motion": {"max_steps": 1}}
    )
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "smpl_ba" in shown.err
    assert np.abs(other["v1"].joints - again["v1"].joints).max() > 0
    states = {s.stage: s.state for s in imocap.status("serve", root=small_run.root)}
    assert states["smpl_ba"] == "cached"


def test_one_off_parameters() -> None:
    assert one_off(None) == []
    assert one_off({"sync": {"max_rate": 8}}) == ["sync.max_rate=8"]
    assert one_off({"sync.method": "als", "seed": 3}) == ['sync.method="als"', "seed=3"]
    shares = {"body25": 0.02}
    assert one_off({"fit.noise_share_of": shares}) == ['fit.noise_share_of={"body25": 0.02}']
    assert one_off(["sync.max_rate=8"]) == ["sync.max_rate=8"]


def wrong_calls(root: Path) -> list[tuple[Callable[[], object], list[str]]]:
    """Calls that must fail, each with the command that fails alike."""
    return [
        (lambda: imocap.run("nobody", root=root), ["run", "nobody"]),
        (
            lambda: imocap.run("serve", root=root, params={"sync": {"magic": 1}}),
            ["run", "serve", "--set", "sync.magic=1"],
        ),
        (
            lambda: imocap.run("serve", root=root, params={"sync.max_rate": "fast"}),
            ["run", "serve", "--set", "sync.max_rate=fast"],
        ),
        (
            lambda: imocap.run("serve", root=root, until="dance"),
            ["run", "serve", "--until", "dance"],
        ),
        (lambda: imocap.explain("serve", "dance", root=root), ["explain", "serve", "dance"]),
        (lambda: imocap.init_action("a/b", ["x.mp4"], root=root), ["init", "a/b", "x.mp4"]),
        (
            lambda: imocap.export("serve", "x", format="glb", up="z", root=root),
            ["export", "serve", "--format", "glb", "--up", "z", "--out", "x"],
        ),
        (lambda: imocap.view("serve", root, root=root), ["view", "serve", "--out", str(root)]),
        (lambda: imocap.compare("serve", "serve", root=root), ["compare", "serve", "serve"]),
    ]


def test_errors_say_what_the_command_line_prints(small_run, capsys):
    for call, words in wrong_calls(small_run.root):
        with pytest.raises(imocap.ImocapError) as caught:
            call()
        code = main(["--root", str(small_run.root), *words])
        printed = capsys.readouterr().err
        assert printed == f"imocap: {caught.value}\n"
        assert code == (2 if isinstance(caught.value, imocap.WrongUse) else 1)


def test_what_load_says(tmp_path: Path, small_run: SmallRun) -> None:
    with pytest.raises(imocap.WorkFailed, match="there is no such folder; expected the artifacts"):
        imocap.load(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(imocap.WorkFailed, match="empty has no keypoints artifact yet; run it with"):
        imocap.load(tmp_path / "empty")
    (tmp_path / "empty" / "keypoints.mcap").write_bytes(b"nonsense")
    with pytest.raises(imocap.WorkFailed, match=r"keypoints of empty: .*; run it with: imocap run"):
        imocap.load(tmp_path / "empty")
    with pytest.raises(imocap.WorkFailed, match=r"action: there is no .*action\.yaml"):
        imocap.load(small_run.root / "artifacts" / "serve", action=tmp_path)


def test_what_run_says(small_run: SmallRun) -> None:
    with pytest.raises(imocap.WrongUse, match=r"expected an action or videos=\[\.\.\.\]"):
        imocap.run()
    with pytest.raises(imocap.WrongUse, match="until: expected a stage whose result has"):
        imocap.run("serve", root=small_run.root, until="sync")
    with pytest.raises(imocap.WrongUse, match=r"params: sync\.max_rate: expected numbers, words"):
        imocap.run("serve", root=small_run.root, params={"sync.max_rate": object()})
    with pytest.raises(imocap.WrongUse, match="there is no video"):
        imocap.run(videos=["nowhere.mp4"], name="new", root=small_run.root)


def test_files_of_a_result(small_run: SmallRun, tmp_path: Path) -> None:
    result = small_run.result
    names = [file.name for file in result.export("bvh", tmp_path / "bvh")]
    assert names == ["v1.bvh", "v2.bvh", "sync.csv", "cameras.json", "export_bvh.json"]
    level = result.levelled("z").on_common_time()
    with np.load(level.export("npz", tmp_path / "npz")[0]) as data:
        assert str(data["up_axis"]) == "z"
        np.testing.assert_allclose(data["joints"], level["v1"].joints)
        assert "phase_s" in data
    page = result.view(tmp_path / "page.html")
    assert page.read_text(encoding="utf-8").startswith("<!doctype html>")
    with pytest.raises(imocap.WrongUse, match="--format: expected one of npz"):
        result.export("obj", tmp_path)


@pytest.mark.long
def test_a_film_of_a_result(small_run: SmallRun, tmp_path: Path) -> None:
    done: list[tuple[str, float, str]] = []
    files = small_run.result.film(
        tmp_path, kind="side-by-side", progress=lambda *report: done.append(report)
    )
    assert [file.name for file in files] == ["side_by_side.mp4"]
    assert done[-1][:2] == ("side_by_side.mp4", 1.0)


@pytest.fixture(scope="module")
def document(small_run: SmallRun) -> dict[str, Any]:
    done = run_action("serve", root=small_run.root)
    text = json.dumps(plain(run_document(done)), allow_nan=False)
    return dict(json.loads(text))


def test_the_stages_are_those_of_the_run(document: dict[str, Any]) -> None:
    assert document["stages"][0]["stage"] == "keypoints"
    assert {row["how"] for row in document["stages"]} == {"cached"}


def test_its_verdict_is_the_result_s(document: dict[str, Any], small_run: SmallRun) -> None:
    verdict = small_run.result.verdict
    assert document["trusted"] is verdict.trusted
    assert document["level"] == verdict.level
    assert document["summary"] == list(verdict.summary)
    sentences = [f.sentence for f in verdict.findings]
    assert set(document["warnings"]) <= set(sentences)
    assert [f["sentence"] for f in document["verdict"]["findings"]] == sentences
    assert all(f.sentence in document["warnings"] for f in verdict.findings if f.serious)


def test_its_correspondences_are_the_result_s(document, small_run):
    rows = {row["video"]: row for row in document["sync"]["videos"]}
    assert tuple(rows) == small_run.result.ids
    assert document["sync"]["reference"] == small_run.result.reference
    assert [name for name, row in rows.items() if row["reference"]] == [small_run.result.reference]
    assert [name for name, row in rows.items() if row["excluded"]] == document["excluded"]
    assert all(0 <= row["matched"] <= 1 and row["frames"] == 24 for row in rows.values())


def test_its_cameras_are_the_result_s(document: dict[str, Any], small_run: SmallRun) -> None:
    for camera in document["cameras"]:
        expected = small_run.result.cameras[camera["video"]]
        np.testing.assert_allclose(camera["R"], expected.R)
        np.testing.assert_allclose(camera["t"], expected.t)
        assert np.shape(camera["K"]) == (3, 3)


def test_an_early_end_leaves_out_what_was_not_reached(small_run: SmallRun) -> None:
    early = run_document(run_action("serve", root=small_run.root, until="sync"))
    assert early["trusted"] is None
    assert early["cameras"] is None
    assert early["sync"]["reference"] in small_run.result.ids


def test_an_action_takes_new_clips_and_keeps_what_it_has(tmp_path: Path) -> None:
    clips = tmp_path / "clips"
    (clips / "more").mkdir(parents=True)

    def ids_then(name: str | None) -> list[str]:
        action, _ = new_action.action_of_videos(tmp_path, name, [clips])
        assert action == (name or "clips")
        return [video.id for video in read_action(tmp_path / "actions" / action).videos]

    with pytest.raises(WrongUse, match="expected videos in the folder, got none"):
        ids_then("serve")
    for name in ("a.mp4", "b.mp4"):
        write_video(clips / name)
    assert ids_then("serve") == ["a", "b"]
    file = tmp_path / "actions" / "serve" / "action.yaml"
    file.write_text(file.read_text() + "event: true  # one performance\n")
    write_video(clips / "more" / "A.mp4")
    write_video(clips / "\u6df1\u8e72.mp4")
    (clips / "b.mp4").unlink()
    assert ids_then("serve") == ["a", "v1", "v2"]
    assert "event: true  # one performance" in file.read_text()
    before = ids_then(None)
    write_video(clips / "c.mp4")
    assert ids_then(None) == [*before, "c"]
    assert ids_then("serve") == ["a", "v1", "v2", "c"]
    assert new_action.action_of_videos(tmp_path, "serve", [clips]) == ("serve", [])


def test_a_change_is_compared_with_the_last_result(small_run: SmallRun) -> None:
    result = small_run.result
    assert moved_mm(None, result) is None
    sentence = compared(result, result)
    assert sentence.startswith("2 videos; the motion of all moved by 0 mm; expected error ")
    error = expected_error_mm(result)
    assert np.isfinite(error)


FAST = {f"{group}.{name}": value for group, name, value in quick() if group == "initial_smpl"}


def waving(frames: np.ndarray) -> np.ndarray:
    """Joints (T, 24, 3) of a body that waves, at any frames."""
    t = frames / 30.0
    rest = np.random.default_rng(3).uniform(-1, 1, (24, 3))
    swing = np.stack([np.sin(2.1 * t), np.cos(1.3 * t), np.sin(3.7 * t + 1)], axis=-1)
    moving = np.zeros((24, 1))
    moving[16:22] = np.linspace(0.3, 0.6, 6)[:, None]
    return np.asarray(rest + moving * swing[:, None])


def test_joints_that_begin_later_are_found() -> None:
    frames = np.arange(60.0)
    sync = imocap.synchronise([waving(frames), waving(frames[12:])], fps=30, reference="v1")
    assert sync.ids == ("v1", "v2")
    assert sync.reference == "v1"
    found = sync.matches("v2", "v1")
    matched = np.isfinite(found.index)
    assert matched.mean() > 0.9
    assert np.abs(found.index - (np.arange(48) + 12))[matched].mean() < 0.5
    assert sync["v2"].phase_s.shape == (48,)
    assert sync.status


def test_the_same_call_gives_the_same_answer() -> None:
    clips = [waving(np.arange(40.0)), waving(np.arange(5.0, 45.0))]
    one, two = (imocap.synchronise(clips, fps=30) for _ in range(2))
    np.testing.assert_array_equal(one["v2"].reference_frame, two["v2"].reference_frame)
    np.testing.assert_array_equal(one["v1"].phase_s, two["v1"].phase_s)


def test_keypoints_as_arrays_and_as_files(two_videos, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    columns = list(two_videos.model.points("body25").columns)
    arrays = []
    for video in two_videos.keypoints.videos:
        points = np.zeros((24, 25, 3))
        points[:, columns, :2] = video.xy_px
        points[:, columns, 2] = 0.9
        arrays.append(points)
    of_arrays = imocap.synchronise(arrays, fps=FPS, layout="body25", size=SIZE, params=FAST)
    assert not (tmp_path / "artifacts").exists()
    folders = [two_videos.write_openpose(tmp_path / f"v{v + 1}", v) for v in range(2)]
    of_files = imocap.synchronise(folders, fps=FPS, size=SIZE, params=FAST, root=tmp_path)
    assert (tmp_path / "artifacts").is_dir()
    assert of_arrays.ids == of_files.ids == ("v1", "v2")
    for name in of_arrays.ids:
        np.testing.assert_allclose(of_arrays[name].phase_s, of_files[name].phase_s, atol=0.2)


J = waving(np.arange(10.0))


@pytest.mark.parametrize(
    ("clips", "options", "sentence"),
    [
        ([J], {"fps": 30}, "clips: expected two or more, got 1"),
        ([J, J], {}, "fps: expected the frames per second"),
        ([J, J[:, :20]], {"fps": 30}, r"expected SMPL's joints .*got \(10, 20, 3\)"),
        ([J, J], {"fps": 30, "reference": "v3"}, "reference 'v3': there is no such clip"),
        ([J, J], {"layout": "body25"}, "2D keypoints as arrays need layout, fps and size"),
        ([J, J[0]], {"layout": "body25", "fps": 30.0, "size": (640, 360)}, r"2D keypoints \(T, K"),
        (["nowhere", "nothing"], {"fps": 30}, "there is no nowhere; expected keypoints"),
        ([J, J], {"fps": 30, "params": {"sync.magic": 1}}, r"sync\.magic: unknown parameter"),
    ],
)
def test_wrong_use(clips: list[Any], options: dict[str, Any], sentence: str) -> None:
    with pytest.raises(imocap.WrongUse, match=sentence):
        imocap.synchronise(clips, **options)


def test_a_video_without_keypoints_needs_a_working_folder(tmp_path: Path) -> None:
    clips = [tmp_path / "a.mp4", tmp_path / "b.mp4"]
    for clip in clips:
        clip.write_bytes(b"")
    with pytest.raises(imocap.WrongUse, match="a, b: no keypoints beside the video; give root="):
        imocap.synchronise(clips)


@pytest.mark.long
def test_four_threads_and_stages_alone_give_the_digests_of_one_thread(small_run, tmp_path):
    """`make chaos` tries every stage alone, and more numbers of threads."""
    action = SmallAction.of(shutil.copytree(small_run.root, tmp_path / "work"))
    part = vary_threads(action, counts=(4,), alone=("sync", "smpl_ba"))
    assert (part["tried"], part["lost"]) == (3, 0), part["what"]
