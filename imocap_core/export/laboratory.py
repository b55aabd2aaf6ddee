"""A video as a trial of a motion laboratory: markers and joint angles, as C3D files hold them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from imocap_core.biomechanics.joint_angles import MIDDLE, PAIRED
from imocap_core.biomechanics.markers import marker_vertices
from imocap_core.conventions import SIDES
from imocap_core.io.writers.c3d import C3dEvent, C3dTrial
from imocap_core.result.events import contact_events
from imocap_core.result.video import VideoResult
from imocap_core.result.video_angles import video_angles
from imocap_core.result.video_body import body_model_of

MM = 1000.0
CONTACT = {"contact_begin": "Foot Strike", "contact_end": "Foot Off"}
CHUNK = 64  # frames whose surface is computed at once
COMPONENTS = {"pelvis": ("tilt", "obliquity", "rotation")}  # X, Y, Z; else in the joint's order


def trial_of(video: VideoResult, up: str) -> C3dTrial:
    """One video in a levelled world whose axis `up` points up; moments it does not show missing."""
    shown = np.where(video.inside, 1.0, np.nan)
    joints = MM * video.joints * shown[:, None, None]
    markers = {name: joints[:, j] for j, name in enumerate(video.joint_names)}
    surface = surface_points_m(video)
    markers |= {name: MM * points * shown[:, None] for name, points in surface.items()}
    angles, about = _angle_points(video, up)
    return C3dTrial(
        subject=video.performer or video.action,
        up=up,
        fps=float(video.fps),
        first=_first_frame(video),
        markers_mm=markers,
        sd_mm=video.joint_sd_mm,
        angles_deg={label: values * shown[:, None] for label, values in angles.items()},
        descriptions=dict.fromkeys(surface, "surface marker") | about,
        events=_contacts(video, up),
    )


def surface_points_m(video: VideoResult) -> dict[str, Float[np.ndarray, "T 3"]]:
    """The surface markers of a video's body, metres, world; by name."""
    vertices = surface_vertices(video)
    index = list(vertices.values())
    parts = [
        video.vertices(np.arange(first, min(first + CHUNK, len(video))))[:, index]
        for first in range(0, len(video), CHUNK)
    ]
    points = np.concatenate(parts)
    return {name: points[:, k] for k, name in enumerate(vertices)}


def surface_vertices(video: VideoResult) -> dict[str, int]:
    """The vertex of every surface marker; the body with fingers has the same surface."""
    model = body_model_of(video, hands=False)
    return marker_vertices(
        model.v_template.numpy(),
        model.weights.numpy(),
        model.joints_template.numpy(),
        model.joint_names,
    )


def _angle_points(
    video: VideoResult, up: str
) -> tuple[dict[str, Float[np.ndarray, "T 3"]], dict[str, str]]:
    """Three angles of a joint as one point, under the labels that laboratories use; and what they
    are. An angle that is not given is 0."""
    angles = video_angles(video, up).angles_deg
    sided = [(f"{side[0].upper()}", side + "_", PAIRED) for side in SIDES]
    points, about = {}, {}
    for letter, prefix, joints in [("", "", MIDDLE), *sided]:
        for joint, definition in joints.items():
            names = COMPONENTS.get(joint, tuple(name for name, _ in definition.angles))
            columns = [angles.get(f"{prefix}{joint}_{n}", np.zeros(len(video))) for n in names]
            label = f"{letter}{joint.capitalize()}Angles"
            points[label] = np.stack(columns, axis=1)
            about[label] = "X, Y, Z: " + ", ".join(
                n if f"{prefix}{joint}_{n}" in angles else "none" for n in names
            )
    return points, about


def _contacts(video: VideoResult, up: str) -> list[C3dEvent]:
    """Beginnings and ends of the feet's contacts, under the labels that laboratories use; times
    count from frame 1."""
    before = _first_frame(video) - 1
    return [
        C3dEvent(CONTACT[event.kind], event.name.capitalize(), (before + event.index) / video.fps)
        for event in contact_events(video, up)
        if video.inside[round(event.index)]
    ]


def _first_frame(video: VideoResult) -> int:
    """The number, from 1, of the first frame in the file; 1 where frames are no even steps."""
    steps = np.diff(video.frames)
    whole = len(steps) == 0 or bool(np.all(steps == 1))
    return int(video.frames[0]) + 1 if whole and float(video.frames[0]).is_integer() else 1
