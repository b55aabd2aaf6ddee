"""How much each detector is believed."""

import pytest

from imocap_core.params import FitParams
from imocap_core.problem.observations import noise_share_of


def test_a_detector_has_its_own_noise_and_others_the_usual() -> None:
    params = FitParams(noise_share=0.01, noise_share_of={"mediapipe33": 0.03})
    assert noise_share_of("mediapipe33", params) == 0.03
    assert noise_share_of("body25", params) == 0.01


def test_mediapipe_is_believed_less_by_default() -> None:
    assert noise_share_of("mediapipe33", FitParams()) > noise_share_of("body25", FitParams())


def test_a_layout_that_there_is_not_is_named() -> None:
    with pytest.raises(ValueError, match=r"noise_share_of: expected some of body25.*, got paws$"):
        noise_share_of("body25", FitParams(noise_share_of={"paws": 0.02}))
