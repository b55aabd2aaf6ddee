"""One performer and the four clips of a seed, made once for all tests of this folder."""

import pytest
import torch

from imocap_core.body import Shaped, load_free_body
from imocap_core.synthetic.yoga_clip import YOGA_SPANS, DemoClip, draw_betas, make_yoga_clip

SEED = 3


@pytest.fixture(scope="session")
def shaped() -> Shaped:
    model = load_free_body(dtype=torch.float64)
    return model.shape(torch.as_tensor(draw_betas(SEED, model.num_betas)))


@pytest.fixture(scope="session")
def clips(shaped: Shaped) -> list[DemoClip]:
    return [make_yoga_clip(SEED, index, shaped) for index in range(len(YOGA_SPANS))]
