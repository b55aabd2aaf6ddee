"""From detections to the observations that a fit works on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.artifacts.schemas import (
    CameraMotion,
    InitialSmpl,
    Keypoints,
    PathUnit,
    VideoCameraMotion,
)
from imocap_core.body import load_free_body
from imocap_core.body.layouts import layouts
from imocap_core.io.estimators.by_name import JOINTS
from imocap_core.motion.kinematics import Body
from imocap_core.motion.observations import Observation
from imocap_core.params import FitParams

UNKNOWN_PATH_M = 0.3  # of the performer's place, where a camera moves along an unknown path


def body_for(keypoints: Keypoints, device: torch.device | str = "cpu") -> Body:
    """The free body with the keypoints of every layout that the videos use.

    device: of its tensors, and so of all that is computed with it.
    """
    return Body.of(load_free_body(device), *layouts_of(keypoints))


def layouts_of(keypoints: Keypoints) -> list[str]:
    """The layouts in use, each once, in order of appearance."""
    return list(dict.fromkeys(v.layout for v in keypoints.videos))


def columns_of(body: Body, keypoints: Keypoints) -> dict[str, tuple[list[int], slice]]:
    """Of every layout in use the points that the body has, and their columns among the keypoints of
    all layouts."""
    columns, end = {}, 0
    for layout in layouts_of(keypoints):
        used = list(body.model.points(layout).columns)
        columns[layout] = used, slice(end, end + len(used))
        end += len(used)
    return columns


def observations_of(
    body: Body,
    keypoints: Keypoints,
    camera_motion: CameraMotion,
    fit: FitParams,
    joints: Mapping[str, Float[np.ndarray, "_ 24 3"]] | None = None,
    units: Sequence[PathUnit] = (),
) -> list[Observation]:
    """Keypoints in the first frame's image, each video's layout in its columns among all.

    Args:
        joints: monocular 3D joints of the videos that have them.
        units: of the paths of moving cameras; a path without a unit is not used.
    """
    metric = {unit.id: unit for unit in units}
    columns = columns_of(body, keypoints)
    width = max((here.stop for _, here in columns.values()), default=0)
    observations, people = [], performers_of(keypoints)
    for video, camera in zip(keypoints.videos, camera_motion.videos, strict=True):
        xy = np.full((len(video.frames), width, 2), np.nan)
        confidence = np.zeros(xy.shape[:2])
        used, here = columns[video.layout]
        xy[:, here], confidence[:, here] = camera.xy_first_px[:, used], video.confidence[:, used]
        confidence[~np.isfinite(xy).all(-1)] = 0.0
        centre, place_sd = path_of(camera, metric.get(video.id))
        observations.append(
            Observation(
                xy,
                confidence,
                camera.K,
                video.fps,
                (joints or {}).get(video.id),
                noise_share=noise_share_of(video.layout, fit),
                focal_spread=fit.focal_spread if camera.focal_source == "assumed" else 0.0,
                R_mean_from_first=camera.R_first_from_frame.mean(axis=0).T,
                performer=people.index(video.performer),
                centre_m=centre,
                place_sd_m=place_sd,
            )
        )
    return observations


def performers_of(keypoints: Keypoints) -> list[str | None]:
    """The performers that are declared, in order of appearance; None: not declared."""
    return list(dict.fromkeys(video.performer for video in keypoints.videos))


def path_of(
    camera: VideoCameraMotion, unit: PathUnit | None
) -> tuple[Float[np.ndarray, "T 3"] | None, Float[np.ndarray, " T"] | None]:
    """Places of a moving camera in metres, and the standard deviation that the performer's place
    has of them; both None on one spot, the first where the path is unknown."""
    if camera.motion != "translating":
        return None, None
    if unit is None or not len(camera.path):
        return None, np.full(len(camera.zoom), UNKNOWN_PATH_M)
    centre = unit.unit_m * camera.path
    from_middle = np.linalg.norm(centre - centre.mean(axis=0), axis=1)
    return centre, np.hypot(unit.unit_m * camera.path_sd, unit.relative_sd * from_middle)


def noise_share_of(layout: str, fit: FitParams) -> float:
    """The noise of a layout's detector, as a share of the person's size.

    Raises:
        ValueError: `fit.noise_share_of` names an unknown layout.
    """
    check_layouts("fit.noise_share_of", fit.noise_share_of)
    return fit.noise_share_of.get(layout, fit.noise_share)


def fit_of(keypoints: Keypoints, fit: FitParams) -> FitParams:
    """The parameters with the shape prior of the videos' layouts, the strongest of several.

    Raises:
        ValueError: `fit.shape_prior_of` names an unknown layout.
    """
    check_layouts("fit.shape_prior_of", fit.shape_prior_of)
    weights = [fit.shape_prior_of.get(x, fit.shape_prior) for x in layouts_of(keypoints)]
    return replace(fit, shape_prior=max(weights, default=fit.shape_prior))


def fit_of_single_views(
    keypoints: Keypoints, fit: FitParams, joints_known: bool, least_shape_prior: float
) -> FitParams:
    """The parameters of fits to single videos: without 3D joints a view does not tell proportions
    from depth, and the shape prior has at least a given weight."""
    of_layouts = fit_of(keypoints, fit)
    if joints_known:
        return of_layouts
    return replace(of_layouts, shape_prior=max(of_layouts.shape_prior, least_shape_prior))


def check_layouts(field: str, table: Mapping[str, float]) -> None:
    """ValueError where a parameter's table names an unknown layout."""
    if unknown := sorted(set(table) - set(layouts())):
        raise ValueError(f"{field}: expected some of {', '.join(layouts())}, got {unknown[0]}")


def estimated_joints(initial: InitialSmpl) -> dict[str, Float[np.ndarray, "_ 24 3"]]:
    """Monocular 3D joints that stay evidence in SMPL-BA: those of an estimator, by video."""
    return {v.id: v.joints for v in initial.videos if initial.source.get(v.id, "") in JOINTS}
