"""How much each detector is believed."""

import numpy as np
import pytest

from imocap_core.adapters.observations import fit_of, fit_of_single_views, noise_share_of
from imocap_core.artifacts.schemas import Keypoints
from imocap_core.params import FitParams
from tests.made_keypoints import made_keypoints


def keypoints_of(*layouts: str) -> Keypoints:
    """One video of two empty frames for each layout."""
    return Keypoints(videos=[made_keypoints(np.arange(2), name, id=name) for name in layouts])


def test_a_detector_has_its_own_noise_and_others_the_usual() -> None:
    params = FitParams(noise_share=0.01, noise_share_of={"mediapipe33": 0.03})
    assert noise_share_of("mediapipe33", params) == 0.03
    assert noise_share_of("body25", params) == 0.01
    with pytest.raises(ValueError, match=r"noise_share_of: expected some of body25.*, got paws$"):
        noise_share_of("body25", FitParams(noise_share_of={"paws": 0.02}))


def test_mediapipe_is_believed_less_by_default() -> None:
    assert noise_share_of("mediapipe33", FitParams()) > noise_share_of("body25", FitParams())


def test_the_strongest_shape_prior_of_the_layouts_is_used() -> None:
    params = FitParams(shape_prior=10.0, shape_prior_of={"mediapipe33": 70.0})
    one = keypoints_of("body25")
    assert fit_of(one, params).shape_prior == 10.0
    assert fit_of(keypoints_of("body25", "mediapipe33"), params).shape_prior == 70.0
    with pytest.raises(ValueError, match=r"shape_prior_of: expected some of body25.*, got paws$"):
        fit_of(one, FitParams(shape_prior_of={"paws": 2.0}))


def test_a_single_view_without_joints_keeps_the_shape_near_the_mean() -> None:
    keypoints, params = keypoints_of("body25"), FitParams(shape_prior=10.0)
    assert fit_of_single_views(keypoints, params, False, 90.0).shape_prior == 90.0
    assert fit_of_single_views(keypoints, params, True, 90.0).shape_prior == 10.0
    assert fit_of_single_views(keypoints, params, False, 5.0).shape_prior == 10.0
