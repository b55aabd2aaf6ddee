"""The fit of a video depends on that video alone, and an action's result on its videos' fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from imocap_core.adapters.monocular import ANY, SingleVideo, fit_single_video, joined, least_cost
from imocap_core.artifacts import codec
from imocap_core.artifacts.schemas import AlternativeMotion, InitialSmpl, StartFit
from imocap_core.motion.prior import load_pose_prior
from imocap_core.params import Params
from tests.report.made import Made


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(count=2, frames=8)


def digests(made: Made, **changes: object) -> tuple[str, str]:
    """What the fit of the first video is made from, with changes of its keypoints."""
    video = made.keypoints.videos[0].model_copy(update=changes)
    single = SingleVideo.of(video, made.camera_motion.videos[0], None)
    return codec.pack(single.keypoints).digest, codec.pack(single.cameras).digest


@pytest.mark.parametrize(
    "changes",
    [{"id": "left"}, {"video": "elsewhere.mp4"}, {"note": "by hand"}, {"performer": "anna"}],
)
def test_names_and_places_do_not_matter(made: Made, changes: dict[str, object]) -> None:
    assert digests(made, **changes) == digests(made)


@pytest.mark.parametrize("field", ["fps", "xy_px", "initial_format"])
def test_what_is_seen_does(made: Made, field: str) -> None:
    video = made.keypoints.videos[0]
    changed = {"fps": 25.0, "xy_px": video.xy_px + 1.0, "initial_format": "smpl_npz"}
    assert digests(made, **{field: changed[field]}) != digests(made)


def test_a_short_video_is_fitted_with_its_alternatives_or_alone(made: Made) -> None:
    params, prior = Params(), load_pose_prior()
    options = replace(params.initial_smpl, starts=2, max_steps=2, library_poses=60, lifter="off")
    single = SingleVideo.of(made.keypoints.videos[1], made.camera_motion.videos[1], None)

    def fit(alone: bool) -> InitialSmpl:
        rng = np.random.default_rng(7)
        return fit_single_video(single, prior, rng, params.fit, options, alone=alone)

    alone, beside = fit(True), fit(False)
    assert alone.alternatives == []
    assert 1 <= len(beside.alternatives) <= options.hypotheses - 1
    assert not np.array_equal(alone.videos[0].theta, beside.videos[0].theta)  # it balances
    assert beside.source == {ANY: "monocular"}
    assert len(beside.grounds) == 1
    stride = single.stride(options)
    assert stride == 3
    costs = [start.cost for start in beside.starts]
    assert least_cost(beside.starts, single.frames, stride) == min(costs) / 3


def test_an_actions_result_has_every_fit_under_its_name(made: Made) -> None:
    def fit(v: int) -> InitialSmpl:
        motion = made.bent[v].model_copy(update={"id": ANY})
        return InitialSmpl(
            model=made.initial.model,
            model_digest=made.initial.model_digest,
            videos=[motion],
            source={ANY: "monocular"},
            starts=[StartFit(video=ANY, name="start 1", cost=3.0 + v, chosen=True)],
            alternatives=[AlternativeMotion(name="depth", excess_cost=1.0 + v, motion=motion)],
        )

    result = joined([fit(0), fit(1)], ["v1", "v2"])
    assert result.videos == made.bent
    assert result.source == made.initial.source
    assert [(start.video, start.cost) for start in result.starts] == [("v1", 3.0), ("v2", 4.0)]
    assert [other.motion.id for other in result.alternatives] == ["v1", "v2"]
