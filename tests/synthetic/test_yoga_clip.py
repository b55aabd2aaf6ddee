"""The demo action on disk: what readers of actions find in it."""

from contextlib import nullcontext
from itertools import islice

import numpy as np
import pytest
import torch

from imocap_core.body.model import rotations_from_pose
from imocap_core.errors import WorkFailed
from imocap_core.executors.tasks import Serial
from imocap_core.io.readers.json_people import read_openpose
from imocap_core.io.truth import read_truth
from imocap_core.io.video import probe
from imocap_core.pipeline import make_demo as demo
from imocap_core.pipeline.action import read_action
from imocap_core.synthetic.yoga_clip import pictures

SEED = 3


@pytest.fixture(scope="module")
def first_pictures(clips, shaped):
    return [
        list(islice(pictures(clip, SEED, index, shaped), 3)) for index, clip in enumerate(clips)
    ]


def _joints_of_pose(true_video, model):
    """World joints by the truth's pose, shape and place."""
    R_local = rotations_from_pose(torch.from_numpy(true_video.theta))
    body = model.shape(torch.from_numpy(true_video.betas))
    return body.pose(R_local, torch.from_numpy(true_video.trans)).joints.numpy()


@pytest.fixture
def quick(clips, shaped, first_pictures, monkeypatch):
    """make_demo without spawned workers, with three pictures a video."""

    monkeypatch.setattr(demo, "worker_processes", lambda _: nullcontext(Serial()))
    monkeypatch.setattr(demo, "make_yoga_clip", lambda seed, index, body: clips[index])
    monkeypatch.setattr(demo, "demo_body", lambda seed: shaped)
    monkeypatch.setattr(demo, "pictures", lambda clip, seed, index, body: first_pictures[index])


@pytest.mark.long
def test_readers_find_what_the_clips_contain(quick, clips, shaped, tmp_path):
    messages: list[str] = []
    demo.make_demo("yoga", tmp_path / "yoga", SEED, messages.append)
    assert len(messages) == 4
    assert [p.name for p in tmp_path.iterdir()] == ["yoga"]  # no leftovers

    action = read_action(tmp_path / "yoga")
    assert [video.id for video in action.videos] == ["v1", "v2", "v3", "v4"]
    assert all(video.focal_px is None and video.initial is None for video in action.videos)
    used = {v.id: np.arange(len(t.joints)) for v, t in zip(action.videos, clips, strict=True)}
    truth = read_truth(tmp_path / "yoga" / str(action.truth), used)
    assert truth.phase_end == 180.0
    for video, clip in zip(action.videos, clips, strict=True):
        info = probe(action.folder / str(video.video))
        assert (info.size, info.fps) == (clip.size, clip.fps)
        detections = read_openpose(action.folder / str(video.keypoints), "body25")
        assert (detections.frames == np.arange(len(clip.joints))).all()
        true_video = truth.videos[video.id]
        np.testing.assert_array_equal(true_video.joints, clip.joints)
        np.testing.assert_array_equal(true_video.phase, clip.motion.phase)
        np.testing.assert_allclose(
            _joints_of_pose(true_video, shaped.model), clip.joints, rtol=0, atol=1e-9
        )
        np.testing.assert_array_equal(true_video.R, clip.camera.R_cam_from_world[0])
        for people, xy, confidence, false_person in zip(
            detections.people,
            clip.detections.xy_px,
            clip.detections.confidence,
            clip.false_people,
            strict=True,
        ):
            assert len(people) == (1 if false_person is None else 2)
            detected = confidence > 0
            gaps = [np.abs(person[detected, :2] - xy[detected]) for person in people]
            assert np.nanmin([np.max(gap) for gap in gaps]) < 1e-3


def test_the_same_seed_writes_the_same_bytes_and_replaces_what_was_there(quick, tmp_path):
    folder = tmp_path / "yoga"

    def contents() -> dict[str, bytes]:
        return {
            str(file.relative_to(folder)): file.read_bytes()
            for file in folder.rglob("*")
            if file.is_file()
        }

    demo.make_demo("yoga", folder, SEED)
    first = contents()
    (folder / "stale.txt").write_text("from an older run")
    demo.make_demo("yoga", folder, SEED)
    assert contents() == first
    assert len(first) > 600


def test_a_failing_run_leaves_nothing_behind(quick, tmp_path, monkeypatch):
    def broken(*_, **__):
        raise OSError("disk full")

    monkeypatch.setattr(demo, "write_h264", broken)
    with pytest.raises(WorkFailed, match="disk full"):
        demo.make_demo("yoga", tmp_path / "yoga", SEED)
    assert list(tmp_path.iterdir()) == []


def test_unknown_demos_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"expected one of yoga, taichi, got 'tennis'"):
        demo.make_demo("tennis", tmp_path / "tennis", SEED)
