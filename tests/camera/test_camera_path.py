"""The path of a camera from its background's points, and from COLMAP."""

from importlib.util import find_spec

import numpy as np
import pytest

from imocap_core.alignment import similarity
from imocap_core.camera.averaging import angle_deg
from imocap_core.camera.camera_path import BackgroundStructure, camera_path
from tests.camera.moving_tracks import FOCAL, FRAMES, SIZE, room_points, tracks_of, turning

SHARE = np.linspace(0, 1, FRAMES)[:, None]
CENTRE = SHARE * np.array([1.2, 0.0, 0.2]) + 0.05 * np.sin(6 * SHARE) * np.array([0.0, 1.0, 0.0])


def path_error(path) -> float:
    """Root mean square over the extent, after a similarity."""
    fit = similarity(path.centre, CENTRE)
    placed = fit.scale * path.centre @ fit.R_target_from_source.T + fit.t_target
    return float(np.sqrt(((placed - CENTRE) ** 2).sum(1).mean()) / np.ptp(CENTRE[:, 0]))


def made(seed, points_m=None):
    rng = np.random.default_rng(seed)
    points, R = room_points(rng), turning()
    tracks = tracks_of(points, R, CENTRE, rng)
    t = -np.einsum("tij,tj->ti", R, CENTRE)
    keys = np.arange(0, FRAMES, 6)
    structure = BackgroundStructure(FOCAL, keys, R[keys], t[keys], np.arange(len(points)), points)
    return tracks, structure, R, points


def test_every_frame_lies_on_the_path():
    tracks, structure, R, points = made(1)
    path = camera_path(structure, tracks, FRAMES, SIZE)
    assert path_error(path) < 0.01
    assert np.linalg.norm(path.centre[0]) == 0
    truth = R[0] @ R.swapaxes(1, 2)
    assert angle_deg(path.R_first_from_frame, truth).max() < 0.3
    unit = float(np.median(np.linalg.norm(points[:, None] - CENTRE[::6], axis=-1)))
    moved = np.linalg.norm(path.centre[-1]) * unit
    assert moved == pytest.approx(np.linalg.norm(CENTRE[-1] - CENTRE[0]), rel=0.1)
    assert 0 < path.sd.max() * unit < 0.05


def test_a_camera_without_enough_points_has_no_path():
    tracks, structure, _, _ = made(2)
    few = BackgroundStructure(
        FOCAL, structure.keys, structure.R, structure.t, structure.track[:8], structure.points[:8]
    )
    assert camera_path(few, tracks, FRAMES, SIZE) is None


@pytest.mark.skipif(find_spec("pycolmap") is None, reason="needs the extra `moving` (pycolmap)")
@pytest.mark.parametrize("refine", [False, True])
def test_colmap_recovers_path_and_focal_length(refine):
    from imocap_core.io.colmap import reconstruct

    tracks, _, _, _ = made(3)
    keys = list(range(0, FRAMES, 5))
    start = 1.15 * FOCAL if refine else FOCAL
    structure = reconstruct(tracks, keys, SIZE, start, refine_focal=refine)
    assert structure.focal_px == pytest.approx(FOCAL, rel=0.03)
    assert len(structure.keys) == len(keys)
    assert path_error(camera_path(structure, tracks, FRAMES, SIZE)) < 0.02


@pytest.mark.skipif(find_spec("pycolmap") is None, reason="needs the extra `moving` (pycolmap)")
def test_colmap_reconstructs_nothing_from_a_turn():
    from imocap_core.io.colmap import reconstruct

    rng = np.random.default_rng(4)
    tracks = tracks_of(room_points(rng), turning(), np.zeros((FRAMES, 3)), rng)
    keys = list(range(0, FRAMES, 5))
    structure = reconstruct(tracks, keys, SIZE, FOCAL, refine_focal=False)
    assert structure is None or len(structure.keys) < 0.8 * len(keys)
