"""Stages compute on the device of their run, and find there what they find on the processor.

The device is a pretended one (`tests/pretended_cuda.py`), so that every machine checks it; whole
actions run on it by `python -m tools.check_on_pretended_cuda`."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from imocap_core import rotations
from imocap_core.adapters.monocular import SingleVideo, fit_single_video, pose_libraries
from imocap_core.artifacts.codec import pack
from imocap_core.artifacts.schemas.base import Artifact
from imocap_core.body import kinematics, load_free_body, model
from imocap_core.evaluate.scoreboard import posed_body
from imocap_core.evaluate.whole_body_scores import measure_surfaces, surface_edges
from imocap_core.motion import normal
from imocap_core.motion.prior import load_pose_prior
from imocap_core.motion.terms import body_priors, smoothness
from imocap_core.params import Params
from imocap_core.pipeline.stage import Inputs
from stages import hands, refine_sync, uncertainty
from tests.adapters.test_hands import seen
from tests.pretended_cuda import Pretended, pretended_cuda
from tests.report.made import Made

Given = dict[type[Artifact], Artifact]
PARAMS = Params()
QUICK = replace(
    PARAMS,
    initial_smpl=replace(
        PARAMS.initial_smpl, lifter="auto", library_poses=4, library_directions=4, max_steps=1
    ),
    sync=replace(PARAMS.sync, consensus_rounds=1),
    motion=replace(PARAMS.motion, rounds=1, max_steps=1),
    refine=replace(PARAMS.refine, max_rounds=1),
)


@pytest.fixture(scope="module")
def made() -> Made:
    """Two videos with hands."""
    scene = Made(count=2, frames=4)
    pairs = zip(scene.keypoints.videos, scene.true, strict=True)
    scene.keypoints.videos[:] = [seen(*pair) for pair in pairs]
    return scene


@pytest.fixture(scope="module")
def given(made: Made) -> Given:
    """What the stages read; the second video is mirrored."""
    sync = made.sync.model_copy(update={"mirrored": ["v2"]})
    refined = made.refined.model_copy(update={"sync": sync})
    read = [made.keypoints, made.camera_motion, made.initial, sync, made.single, refined]
    read.append(made.again)
    return {type(artifact): artifact for artifact in read}


@pytest.fixture(autouse=True)
def the_card_s_elimination_as_lapack_rounds_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (rotations, kinematics, model, normal, body_priors, smoothness):
        monkeypatch.setattr(module, "for_processor", lambda values: False)


def result(stage: Any, given: Given, device: str) -> Artifact:
    context = SimpleNamespace(
        device=device, progress=lambda share, text: None, event=lambda: False,
        hints=lambda: ((), ()), mirrored=lambda: {"v1": None, "v2": True},
        action_file=lambda: None, rng=lambda: np.random.default_rng(5),
    )  # fmt: skip
    inputs = Inputs(stage.__name__, {}, dict(given))
    done: Artifact = stage.run(context, inputs, QUICK)
    return done


@pytest.mark.parametrize(
    "stage", [pytest.param(refine_sync, marks=pytest.mark.long), uncertainty, hands]
)
def test_a_stage_computes_on_its_device(stage: Any, given: Given, unchecked_shapes: None) -> None:
    here = result(stage, given, "cpu")
    before = Pretended.calls
    with pretended_cuda():
        there = result(stage, given, "cuda")
    assert Pretended.calls - before > 10_000
    assert pack(there).digest == pack(here).digest


@pytest.mark.long
def test_a_single_video_is_lifted_and_fitted_on_the_device_of_its_prior(made, unchecked_shapes):
    single = SingleVideo.of(made.keypoints.videos[0], made.camera_motion.videos[0], None)

    def fitted(device: str) -> Artifact:
        prior, options, rng = load_pose_prior(device), QUICK.initial_smpl, np.random.default_rng(5)
        libraries = pose_libraries(prior, lambda: rng, options)
        return fit_single_video(single, prior, libraries, QUICK.fit, options, alone=True)

    here = fitted("cpu")
    with pretended_cuda():
        assert pack(fitted("cuda")).digest == pack(here).digest


def test_surfaces_are_skinned_on_the_device_of_their_model(made, unchecked_shapes):
    def stretched(device: str) -> np.ndarray:
        model = load_free_body(device)
        bodies = [posed_body(model, motion, [0, 1]) for motion in (made.bent[0], made.true[0])]
        (measures,) = measure_surfaces(bodies[:1], bodies[1], surface_edges(model))
        return np.append(measures.stretched_shares, measures.errors.pve)

    here = stretched("cpu")
    with pretended_cuda():
        assert stretched("cuda").tolist() == here.tolist()


def test_what_a_card_refuses_the_pretended_one_refuses() -> None:
    with pretended_cuda():
        there, here = torch.ones(3, device="cuda"), torch.ones(3)
        assert there.device.type == (there + here[0]).device.type == "cuda"
        assert here.to(there).is_cuda
        for refused in (
            lambda: there + here,
            lambda: torch.stack([there[0], here[0]]),
            lambda: here[there.long()],
        ):
            with pytest.raises(RuntimeError, match="device"):
                refused()
        for read in (there.numpy, lambda: np.asarray(there)):
            with pytest.raises(TypeError, match="cuda:0"):
                read()
        assert there.cpu().numpy().tolist() == there.tolist() == [1.0, 1.0, 1.0]
