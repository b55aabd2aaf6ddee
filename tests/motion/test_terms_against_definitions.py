"""Terms worked out quickly, against slow twins that follow their definitions."""

from dataclasses import fields, replace

import torch
from torch import Tensor

from imocap_core.motion.gauss_newton import linearise
from imocap_core.motion.normal import NormalEquations
from imocap_core.motion.state import FRAME_UNKNOWNS, POSE, Body, MotionState
from imocap_core.motion.terms import FootContact, JointEvidence, PoseSmoothness, Reprojection, Term
from imocap_core.motion.terms.reprojection import CONVERGED, INNER_STEPS, solve_rigid_offsets
from imocap_core.motion.terms.view import (
    View,
    by_rigid_offset,
    project,
    projection_jacobian,
    with_rigid_offset,
)
from imocap_core.robust import geman_mcclure
from imocap_core.rotations import exp, hat
from tests.motion.test_terms import TERMS, B, T, normal, seen, state, with_rigid_offsets

__all__ = ["state"]  # a fixture


def two_offset_views(body: Body, state: MotionState) -> Reprojection:
    """One of a known camera, one of the state's own, each with its own rigid offsets."""
    first = with_rigid_offsets(body, state)
    (view,) = first.views
    known = replace(
        view.with_camera_of(state),
        camera=None,
        focal=None,
        xy_px=view.xy_px + normal(B, T, 25, 2, seed=40),
    )
    turned = exp(normal(B, 3, seed=41, spread=0.2)) @ known.R
    return replace(first, views=(view, replace(known, R=turned)))


def weighted(term: Reprojection, view: View, xyz: Tensor) -> tuple[Tensor, Tensor]:
    """Residuals and their derivatives by points in camera axes, robust weights included."""
    pixels, x_cam = project(view, xyz)
    error = pixels - view.xy_px
    squared = view.weight * error.square().sum(-1)
    root = (view.weight * geman_mcclure(squared, term.scale)[1]).sqrt()[..., None]
    return error * root, projection_jacobian(view, x_cam) * root[..., None]


def solve_slowly(
    term: Reprojection, view: View, xyz: Tensor, pivot: Tensor, precision: Tensor
) -> tuple[Tensor, Tensor]:
    d = torch.zeros_like(precision)
    for _ in range(INNER_STEPS):
        at = with_rigid_offset(xyz, pivot, d)
        residual, by_camera = weighted(term, view, at)
        rows = by_rigid_offset(by_camera @ view.R[:, None, None], at, pivot, d).flatten(2, 3)
        gradient = (rows.mT @ residual.flatten(2)[..., None])[..., 0] + precision * d
        sharpness = rows.mT @ rows + torch.diag_embed(precision)
        step = torch.linalg.solve(sharpness, gradient)
        d = d - step
        if float(step.abs().max()) < CONVERGED:
            break
    return d, sharpness


def test_the_inner_solve_ends_where_the_definition_says(body: Body, state: MotionState) -> None:
    term = two_offset_views(body, state)
    xyz = body.positions(body.keypoints, state)
    pivot = state.trans + body.model.shape(state.betas).joints_rest[:, 0][:, None]
    precision = normal(B, T, 6, seed=42).abs() * 100 + 20  # of every axis its own
    for view in (view.with_camera_of(state) for view in term.views):
        expected = solve_slowly(term, view, xyz, pivot, precision)
        found = solve_rigid_offsets(view, term.scale, xyz, pivot, precision)
        assert float(expected[0].abs().max()) > 0.01
        for mine, theirs in zip(found, expected, strict=True):
            assert torch.allclose(mine, theirs, rtol=1e-9, atol=1e-10 * float(theirs.abs().max()))


def rows_of(term: Reprojection, state: MotionState) -> NormalEquations:
    """All rows of every view, its rigid offsets' among them, and their Schur complement."""
    body, m = term.body, state.unknown_globals
    found = NormalEquations.zeros(B, T, FRAME_UNKNOWNS, m, state.trans)
    points = body.derivatives(body.keypoints, state)
    pivot = state.trans + body.model.shape(state.betas).joints_rest[:, 0][:, None]
    for fixed in term.views:
        view, (xyz, d) = fixed.with_camera_of(state), term.offset_points(fixed, state)
        residual, by_camera = weighted(term, view, xyz)
        by_point = by_camera @ view.R[:, None, None]
        turned = by_point @ exp(d[:, :, None, :3])
        rows = torch.zeros(B, T, 25, 2, FRAME_UNKNOWNS + m + 6).double()
        rows[..., :POSE] = turned @ points.d_pose
        rows[..., POSE:FRAME_UNKNOWNS] = by_point
        rows[..., FRAME_UNKNOWNS : FRAME_UNKNOWNS + 10] = turned @ points.d_beta
        if view.camera is not None:
            lever = (xyz - state.pivot()[:, None, None]) @ view.R[:, None].mT
            own = state.camera_columns(view.camera)
            rows[..., FRAME_UNKNOWNS + own.start : FRAME_UNKNOWNS + own.stop] = torch.cat(
                [by_camera @ -hat(lever), by_camera], -1
            )
        if view.focal is not None:
            centre = view.K[:, None, None, :2, 2]
            pixels, _ = project(view, xyz)
            grows = residual * (pixels - centre) / (pixels - view.xy_px)
            rows[..., FRAME_UNKNOWNS + state.focal_column(view.focal)] = grows
        if view.shifts is not None:
            scores = state.score_columns(view.performance)
            columns = slice(FRAME_UNKNOWNS + scores.start, FRAME_UNKNOWNS + scores.stop)
            rows[..., columns] = turned @ view.shifts
        if view.offset_precision is not None:
            rows[..., -6:] = by_rigid_offset(by_point, xyz, pivot, d)
        flat = rows.flatten(2, 3)
        full, gradient = flat.mT @ flat, (flat.mT @ residual.flatten(2)[..., None])[..., 0]
        if view.offset_precision is not None:
            information = full[..., -6:, -6:] + torch.diag_embed(view.offset_precision)
            full = full - full[..., -6:] @ torch.linalg.solve(information, full[..., -6:, :])
        n = FRAME_UNKNOWNS
        found.diagonal += full[..., :n, :n]
        found.border += full[..., :n, n:-6]
        found.corner += full[..., n:-6, n:-6].sum(1)
        found.gradient += gradient[..., :n]
        found.corner_gradient += gradient[..., n:-6].sum(1)
    return found


def test_views_gathered_by_their_points_are_their_rows(body: Body, state: MotionState) -> None:
    by_name = (TERMS[f"reprojection{of}"](body, state) for of in ("", " of performances"))
    for term in (*by_name, two_offset_views(body, state)):
        expected = rows_of(term, state)
        found = NormalEquations.zeros(B, T, FRAME_UNKNOWNS, state.unknown_globals, state.trans)
        term.add_to(found, state)
        assert_equal(found, expected)


def test_compiled_products_over_pairs_are_those_of_whole_matrices(
    body: Body, state: MotionState
) -> None:
    points = body.derivatives(body.keypoints, state)
    metric, values = normal(B, T, 25, 3, 3, seed=48), normal(B, T, 25, 3, 4, seed=49)
    for moves, unknowns in ((False, POSE), (True, FRAME_UNKNOWNS)):
        whole, found = points.by_frame(moves), torch.ones(B, T, unknowns, unknowns).double()
        points.add_products(found, points, metric)
        expected = 1 + whole.flatten(2, 3).mT @ (metric @ whole).flatten(2, 3)
        assert torch.allclose(found, expected, rtol=1e-9, atol=1e-9)
    expected = whole.flatten(2, 3).mT @ values.flatten(2, 3)
    assert torch.allclose(points.pulled(values), expected, rtol=1e-9, atol=1e-9)


def assert_equal(found: NormalEquations, expected: NormalEquations) -> None:
    for field in fields(found):
        mine, theirs = getattr(found, field.name), getattr(expected, field.name)
        assert torch.allclose(mine, theirs, rtol=0, atol=1e-10 * (1 + float(theirs.abs().max())))


def test_estimates_together_are_the_sum_of_each(body: Body, state: MotionState) -> None:
    joints, weight = normal(B, T, 3, 24, 3, seed=43), normal(B, T, 3, 24, seed=44).abs()
    weight = weight * seen(state)[..., None] * (normal(3, 24, seed=45) > -0.5)  # some are not given
    each = [JointEvidence(body, joints[:, :, e], weight[:, :, e], 3.0) for e in range(3)]
    together = JointEvidence(body, joints, weight, 3.0)
    costs = torch.stack([term.cost(state) for term in each]).sum(0)
    assert torch.allclose(together.cost(state), costs, rtol=1e-12)
    assert_equal(linearise([together], state), linearise(each, state))


def test_an_estimate_weighs_as_its_centred_joints_do(body: Body, state: MotionState) -> None:
    joints, weight = normal(B, T, 24, 3, seed=46), normal(B, T, 24, seed=47).abs()
    found = linearise([JointEvidence(body, joints, weight, 1e9)], state)
    share = weight / weight.sum(-1, keepdim=True)
    d_xyz = body.derivatives(body.joints, state).d_pose
    centred = d_xyz - (share[..., None, None] * d_xyz).sum(2, keepdim=True)
    rows = (weight.sqrt()[..., None, None] * centred).flatten(2, 3)
    expected = rows.mT @ rows
    mine = found.diagonal[state.valid][..., :POSE, :POSE]
    assert torch.allclose(mine, expected[state.valid], atol=1e-9 * float(expected.abs().max()))


def chords(state: MotionState) -> Tensor:
    """Accelerations as `PoseSmoothness` weighs them: half of a chord's squared length."""
    R = state.R_local
    return ((R[:, :-2] - 2 * R[:, 1:-1] + R[:, 2:]) / 2**0.5).flatten()


def steps_of_feet(body: Body, state: MotionState) -> Tensor:
    feet = body.positions(body.feet, state)
    return (feet[:, 1:] - feet[:, :-1]).flatten()


def test_terms_that_couple_frames_are_their_rows(body: Body, state: MotionState) -> None:
    """Far below their scales: ``J^T J`` of the residuals, J by automatic differentiation."""
    one = state.of_motion(0, 4)
    start = MotionState.of(one.R_local, one.trans, one.betas, one.valid)
    bend = PoseSmoothness(torch.zeros(24).double(), torch.ones(24).double(), 1e9)
    cases: list[tuple[Term, object]] = [
        (bend, lambda s: chords(s)),
        (FootContact(body, 1.0, 1e9), lambda s: steps_of_feet(body, s)),
    ]
    for term, residuals in cases:

        def moved(d: Tensor, residuals: object = residuals) -> Tensor:
            assert callable(residuals)
            return residuals(start.retract(d[None], torch.zeros_like(start.betas)))

        zero = torch.zeros(4, FRAME_UNKNOWNS).double()
        J = torch.autograd.functional.jacobian(moved, zero, vectorize=True).flatten(1)
        expected = (J.mT @ J).unflatten(0, (4, -1)).unflatten(2, (4, -1))
        found = linearise([term], start)
        for apart, blocks in enumerate((found.diagonal, found.next1, found.next2)):
            for t in range(4 - apart):
                error = blocks[0, t] - expected[t, :, t + apart]
                assert float(error.abs().max()) < 1e-8 * float(expected.abs().max())


def test_what_a_state_was_asked_before_is_not_worked_out_again(state: MotionState) -> None:
    asked = []

    def answer() -> int:
        asked.append(1)
        return len(asked)

    one, other = object(), object()
    assert [state.cached((one,), answer) for _ in range(3)] == [1, 1, 1]
    assert state.cached((one, other), answer) == 2
    assert replace(state).cached((one,), answer) == 3


def rows_of_feet(term: FootContact, state: MotionState) -> NormalEquations:
    """Every step's weighted row by all unknowns of both frames and of the shape."""
    n = FRAME_UNKNOWNS
    found = NormalEquations.zeros(B, T, n, state.unknown_globals, state.trans)
    feet = term.body.derivatives(term.body.feet, state)
    place = torch.eye(3).double().expand(*feet.xyz.shape, 3)
    frame = torch.cat([feet.d_pose, place], -1)
    step = feet.xyz[:, 1:] - feet.xyz[:, :-1]
    squared = term.weight * step.square().sum(-1)
    trust = term.weight * geman_mcclure(squared, term.scale)[1]
    root = (trust * (state.valid[:, 1:] & state.valid[:, :-1])[..., None]).sqrt()[..., None]
    residual = (root * step).flatten(2)[..., None]
    shape = feet.d_beta[:, 1:] - feet.d_beta[:, :-1]
    rows = torch.cat([-frame[:, :-1], frame[:, 1:], shape], -1) * root[..., None]
    flat = rows.flatten(2, 3)
    full, gradient = flat.mT @ flat, (flat.mT @ residual)[..., 0]
    found.next1[:, :-1] += full[..., :n, n : 2 * n]
    for own, frames in ((slice(n), slice(T - 1)), (slice(n, 2 * n), slice(1, T))):
        found.diagonal[:, frames] += full[..., own, own]
        found.border[:, frames, :, :10] += full[..., own, 2 * n :]
        found.gradient[:, frames] += gradient[..., own]
    found.corner[:, :10, :10] += full[..., 2 * n :, 2 * n :].sum(1)
    found.corner_gradient[:, :10] += gradient[..., 2 * n :].sum(1)
    return found


def test_feet_add_what_their_rows_say(body: Body, state: MotionState) -> None:
    term = FootContact(body, normal(B, T - 1, 4, seed=50).abs() + 0.1, 0.8)
    found = NormalEquations.zeros(B, T, FRAME_UNKNOWNS, state.unknown_globals, state.trans)
    term.add_to(found, state)
    assert_equal(found, rows_of_feet(term, state))


def test_the_inner_solve_has_one_end_wherever_it_starts(body: Body, state: MotionState) -> None:
    term = with_rigid_offsets(body, state)
    (view,) = term.views
    precision = normal(B, T, 6, seed=42).abs() * 100 + 20
    expected, sharpness = term.rigid_offsets(view, state, precision)
    elsewhere = expected + normal(B, T, 6, seed=43, spread=0.05)
    for start in (expected, elsewhere):
        found, sharp = term.rigid_offsets(view, state, precision, start)
        assert float((found - expected).abs().max()) < 2 * CONVERGED
        assert torch.allclose(sharp, sharpness, rtol=1e-2, atol=1e-2 * float(sharpness.abs().max()))
