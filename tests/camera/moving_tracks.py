"""Feature tracks of made backgrounds, as a camera that turns, zooms or walks films them."""

import numpy as np
from scipy.spatial.transform import Rotation

from imocap_core.camera.background import FeatureTracks
from imocap_core.camera.projection import Lens, intrinsics, project

SIZE, FOCAL, FRAMES = (640, 360), 600.0, 48


def room_points(rng, count=260):
    """Points of a floor, a back wall and things between; metres, camera axes of the first frame."""
    x = rng.uniform(-4, 4, count)
    z = rng.uniform(2.5, 7.0, count)
    y = np.where(rng.random(count) < 0.5, 1.3, rng.uniform(-1.5, 1.3, count))
    return np.column_stack([x, y, np.where(rng.random(count) < 0.4, 7.0, z)])


def wall_points(rng, count=260):
    """Points of a wall straight ahead."""
    xy = rng.uniform((-5, -2.5), (5, 2.5), (count, 2))
    return np.column_stack([xy, 6.0 + 0.3 * xy[:, 0]])


def turning(widest_deg=12.0):
    """Rotations camera from world of a camera that pans and tilts."""
    share = np.linspace(0, 1, FRAMES)
    angles = np.column_stack([widest_deg * share, 3 * np.sin(4 * share), np.zeros(FRAMES)])
    return Rotation.from_euler("yxz", angles, degrees=True).as_matrix()


def tracks_of(points, R, centre, rng, zoom=None, distortion=0.0, noise_px=0.3):
    """Tracks of all points while they are in the picture; distortion as of `TripodCamera`."""
    zoom = np.ones(FRAMES) if zoom is None else zoom
    middle = (np.array(SIZE) - 1) / 2
    corner = float(np.linalg.norm(middle))
    lens = Lens.of([distortion], np.diag([corner, corner, 1.0]))
    rows = []
    for t in range(FRAMES):
        K = intrinsics(FOCAL * zoom[t], SIZE)
        straight = project(points, K, R[t], -R[t] @ centre[t]) - middle
        off = lens.distorted(straight)
        xy = off + middle + noise_px * rng.normal(size=off.shape)
        inside = np.isfinite(xy).all(1) & ((xy > 0) & (xy < np.array(SIZE))).all(1)
        rows += [(k, t, *xy[k]) for k in np.nonzero(inside)[0]]
    table = np.array(rows)
    return FeatureTracks(table[:, 0].astype(int), table[:, 1].astype(int), table[:, 2:])
