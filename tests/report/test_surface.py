"""Errors of surfaces: which vertices they speak of."""

import numpy as np
import torch

from imocap_core.body import Posed, load_free_body
from imocap_core.evaluate.whole_body_scores import VertexErrors, measure_surfaces, surface_mesh


def test_hands_that_turn_are_no_error_of_the_rest_of_the_surface() -> None:
    model = load_free_body()
    rest = torch.eye(3, dtype=model.dtype).expand(2, 24, 3, 3).contiguous()
    turned = rest.clone()
    wrist = model.joint_names.index("left_wrist")
    turned[:, wrist] = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], dtype=model.dtype)
    still = torch.zeros(2, 3, dtype=model.dtype)
    shaped = model.shape(torch.zeros(model.num_betas, dtype=model.dtype))
    errors = _errors_mm(shaped.pose(turned, still), shaped.pose(rest, still))
    assert errors.pve > 5
    assert 0 < errors.pve_without_hands < 0.05 * errors.pve  # what the wrist's skin drags along
    assert _errors_mm(shaped.pose(turned, still), shaped.pose(turned, still)).pve == 0


def _errors_mm(predicted: Posed, true: Posed) -> VertexErrors:
    mesh = surface_mesh(predicted.shaped.model)
    alone = measure_surfaces([predicted], None, mesh)[0]
    first, second = measure_surfaces([predicted, true], true, mesh)
    assert alone.errors is None
    np.testing.assert_array_equal(alone.stretched_shares, first.stretched_shares)
    assert first.errors is not None
    assert second.errors is not None
    assert second.errors.pve == 0
    return first.errors
