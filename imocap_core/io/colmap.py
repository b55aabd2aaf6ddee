"""Structure from motion by COLMAP (pycolmap, the optional extra `moving`) from feature tracks."""

from __future__ import annotations

import signal
import tempfile
import threading
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int64

from imocap_core.camera.background import FeatureTracks
from imocap_core.camera.camera_path import BackgroundStructure

FEWEST_MATCHES = 20  # tracks that two key frames share
ERROR_PX = 2.0  # largest of an inlier, in the pictures that were tracked in
ANGLE_DEG = 0.7  # least between two rays that meet in a point
FIRST_ANGLES_DEG = (4.0, 2.0, 1.0)  # of the pair that the reconstruction starts from, tried in turn
SEED = 1
HALF_PIXEL = 0.5  # COLMAP's origin is the corner of the first pixel


def colmap_installed() -> bool:
    """Whether the extra is installed."""
    return find_spec("pycolmap") is not None


def load_colmap() -> None:
    """Import the extra where it is installed, from the main thread: its handlers of signals, which
    print a stack trace, are replaced by those that were there."""
    if not colmap_installed():
        return
    kinds = (signal.SIGTERM, signal.SIGINT, signal.SIGABRT, signal.SIGSEGV, signal.SIGFPE)
    before = {kind: signal.getsignal(kind) for kind in kinds}
    import_module("pycolmap")
    if threading.current_thread() is threading.main_thread():
        for kind, handler in before.items():
            signal.signal(kind, handler if handler is not None else signal.SIG_DFL)


def reconstruct(
    tracks: FeatureTracks,
    keys: Sequence[int],
    size: tuple[int, int],
    focal_px: float,
    *,
    refine_focal: bool,
) -> BackgroundStructure | None:
    """Incremental structure from motion over key frames; None where it does not succeed.

    Args:
        focal_px: given, or the start of its refinement.
    """
    pycolmap = import_module("pycolmap")
    pycolmap.logging.minloglevel = 3
    with tempfile.TemporaryDirectory(prefix="imocap-colmap-") as folder:
        database = Path(folder) / "database.db"
        visible = _write_tracks(pycolmap, database, tracks, keys, size, focal_px, refine_focal)
        pycolmap.geometric_verification(
            database,
            pycolmap.GeometricVerifierOptions(num_threads=1),
            pycolmap.ExistingMatchedPairingOptions(),
            _two_view_options(pycolmap),
        )
        for angle in FIRST_ANGLES_DEG:
            models = pycolmap.incremental_mapping(
                database, folder, folder, _options(pycolmap, angle, refine_focal)
            )
            if models:
                largest = max(models.values(), key=lambda model: model.num_reg_images())
                return _structure(largest, keys, visible)
    return None


def _write_tracks(
    pycolmap: Any,
    database: Path,
    tracks: FeatureTracks,
    keys: Sequence[int],
    size: tuple[int, int],
    focal_px: float,
    refine_focal: bool,
) -> dict[int, Int64[np.ndarray, " P"]]:
    """Key frames as images, tracks as their matches; the tracks of each image."""
    camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", focal_px, *size)
    camera.has_prior_focal_length = not refine_focal
    visible, images = {}, {}
    with pycolmap.Database.open(database) as store:
        camera_id = store.write_camera(camera)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera_id))
        rig_id = store.write_rig(rig)
        for key in keys:
            ids, xy = tracks.at(key)
            name = f"{key:08d}"
            image_id = store.write_image(pycolmap.Image(name=name, camera_id=camera_id))
            frame = pycolmap.Frame(rig_id=rig_id)
            frame.add_data_id(
                pycolmap.data_t(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, camera_id), image_id)
            )
            store.write_frame(frame)
            store.write_keypoints(image_id, (xy + HALF_PIXEL).astype(np.float32))
            visible[key], images[key] = ids, image_id
        for k, a in enumerate(keys):
            for b in keys[k + 1 :]:
                shared, rows_a, rows_b = np.intersect1d(
                    visible[a], visible[b], assume_unique=True, return_indices=True
                )
                if len(shared) >= FEWEST_MATCHES:
                    matches = np.column_stack([rows_a, rows_b]).astype(np.uint32)
                    store.write_matches(images[a], images[b], matches)
    return visible


def _two_view_options(pycolmap: Any) -> Any:
    options = pycolmap.TwoViewGeometryOptions()
    options.ransac.max_error = ERROR_PX
    options.ransac.random_seed = SEED
    options.detect_watermark = False
    return options


def _options(pycolmap: Any, first_angle_deg: float, refine_focal: bool) -> Any:
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads, options.random_seed = 1, SEED
    options.multiple_models, options.extract_colors = False, False
    options.min_model_size = 3
    options.ba_refine_focal_length = refine_focal
    options.ba_refine_extra_params = False
    options.mapper.init_min_num_inliers = 30
    options.mapper.init_max_error = options.mapper.filter_max_reproj_error = ERROR_PX
    options.mapper.init_min_tri_angle = first_angle_deg
    options.mapper.ba_local_min_tri_angle = first_angle_deg
    options.mapper.filter_min_tri_angle = options.triangulation.min_angle = ANGLE_DEG
    options.mapper.abs_pose_max_error = 2 * ERROR_PX
    options.mapper.abs_pose_refine_focal_length = refine_focal
    options.mapper.num_threads, options.mapper.random_seed = 1, SEED
    return options


def _structure(
    model: Any, keys: Sequence[int], visible: dict[int, Int64[np.ndarray, " P"]]
) -> BackgroundStructure:
    """The registered key frames, and each track's point: the one that most key frames give it."""
    poses: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    votes: dict[tuple[int, int], int] = {}
    for image_id in model.reg_image_ids():
        image = model.image(image_id)
        key = int(image.name)
        pose = image.cam_from_world()
        poses[key] = (pose.rotation.matrix(), np.asarray(pose.translation))
        for track, point in zip(visible[key], image.points2D, strict=True):
            if point.has_point3D():
                pair = (int(track), int(point.point3D_id))
                votes[pair] = votes.get(pair, 0) + 1
    chosen: dict[int, tuple[int, int]] = {}
    for (track, point_id), count in sorted(votes.items()):
        if count > chosen.get(track, (0, 0))[0]:
            chosen[track] = (count, point_id)
    ids = np.array(sorted(chosen), dtype=np.int64)
    registered = np.array([key for key in keys if key in poses], dtype=np.int64)
    points = [model.point3D(chosen[int(track)][1]).xyz for track in ids]
    return BackgroundStructure(
        focal_px=float(next(iter(model.cameras.values())).params[0]),
        keys=registered,
        R=np.stack([poses[int(key)][0] for key in registered]),
        t=np.stack([poses[int(key)][1] for key in registered]),
        track=ids,
        points=np.array(points).reshape(-1, 3),
    )
