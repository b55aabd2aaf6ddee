"""Files for a motion laboratory: markers and joint angles for C3D; models and motions for OpenSim.

Files for OpenSim, per video:

    <id>.osim    the body as a linkage with ISB's angles, of the performer's size, with markers
    <id>.trc     the markers' places over time
    <id>_ik.xml  inverse kinematics of the two, to run as it is
    <id>.mot     our joint angles as the model's coordinates
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from imocap_core.biomechanics.joint_angles import MIDDLE, PAIRED
from imocap_core.biomechanics.linkage import (
    Link,
    linkage,
    linkage_coordinates,
    segment_masses,
    segment_of_joint,
    to_ground,
)
from imocap_core.biomechanics.segments import marker_vertices, surface_markers
from imocap_core.conventions import SIDES, SMPL_JOINTS
from imocap_core.io.writers.c3d import C3dEvent, C3dTrial
from imocap_core.io.writers.osim import (
    Place,
    write_generic_markers,
    write_generic_setups,
    write_ik_setup,
    write_mot,
    write_osim,
)
from imocap_core.io.writers.text_files import write_markers
from imocap_core.result import video_motion
from imocap_core.result.body import body_model
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult

MM = 1000.0
CONTACT = {"contact_begin": "Foot Strike", "contact_end": "Foot Off"}
CHUNK = 64  # frames whose surface is computed at once
COMPONENTS = {"pelvis": ("tilt", "obliquity", "rotation")}  # X, Y, Z; else in the joint's order


def trial_of(video: VideoResult, up: str) -> C3dTrial:
    """One video in a levelled world whose axis `up` points up; moments it does not show missing."""
    shown = np.where(video.inside, 1.0, np.nan)
    joints = MM * video.joints * shown[:, None, None]
    markers = {name: joints[:, j] for j, name in enumerate(video.joint_names)}
    surface = _surface_points_m(video)
    markers |= {name: MM * points * shown[:, None] for name, points in surface.items()}
    angles, about = _angle_points(video, up)
    first = _first_frame(video)
    return C3dTrial(
        subject=video.performer or video.action,
        up=up,
        fps=float(video.fps),
        first=first,
        markers_mm=markers,
        sd_mm=video.joint_sd_mm,
        angles_deg={label: values * shown[:, None] for label, values in angles.items()},
        descriptions=dict.fromkeys(surface, "surface marker") | about,
        events=[
            C3dEvent(CONTACT[e.kind], e.name.capitalize(), (first - 1 + e.index) / video.fps)
            for e in video_motion.contact_events(video, up)
            if video.inside[round(e.index)]
        ],
    )


def _surface_points_m(video: VideoResult) -> dict[str, Float[np.ndarray, "T 3"]]:
    """The surface markers of a video's body, metres, world; by name."""
    vertices = _surface_vertices(video)
    index = list(vertices.values())
    parts = [
        video.vertices(np.arange(first, min(first + CHUNK, len(video))))[:, index]
        for first in range(0, len(video), CHUNK)
    ]
    points = np.concatenate(parts)
    return {name: points[:, k] for k, name in enumerate(vertices)}


def _surface_vertices(video: VideoResult) -> dict[str, int]:
    """The vertex of every surface marker; the body with fingers has the same surface."""
    model = body_model(video.model, video.action, hands=False)
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
    angles = video_motion.video_angles(video, up).angles_deg
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


def _first_frame(video: VideoResult) -> int:
    """The number, from 1, of the first frame in the file; 1 where frames are no even steps."""
    steps = np.diff(video.frames)
    whole = len(steps) == 0 or bool(np.all(steps == 1))
    return int(video.frames[0]) + 1 if whole and float(video.frames[0]).is_integer() else 1


SEGMENT_OF_JOINT = {joint: segment_of_joint(joint) for joint in SMPL_JOINTS}
JOINT_MARKERS = tuple(joint for joint, segment in SEGMENT_OF_JOINT.items() if segment is not None)


def write_opensim(out: Path, result: ActionResult) -> list[Path]:
    """Write the files of every video of a result whose y points up; their paths."""
    files = [file for video in result for file in _files(out, video)]
    return [*files, write_generic_markers(out)]


def _files(out: Path, video: VideoResult) -> list[Path]:
    model, markers, setup, motion = (
        out / f"{video.id}{ending}" for ending in (".osim", ".trc", "_ik.xml", ".mot")
    )
    rest_m = video_motion.rest_joints_m(video)
    links = linkage(rest_m)
    mass_kg = _write_model(model, video, links, rest_m)
    joints = {j: video.body_joints[:, SMPL_JOINTS.index(j)] for j in JOINT_MARKERS}
    paths_mm = {n: MM * to_ground(p) for n, p in (joints | _surface_points_m(video)).items()}
    start = round(float(video.frames[0]))
    write_markers(markers, paths_mm, video.fps, start)
    last_s = (len(video) - 1) / video.fps
    write_ik_setup(setup, video.id, paths_mm, last_s)
    values = linkage_coordinates(
        links, video_motion.body_rotations(video), video.body_joints, rest_m
    )
    turning = {c.name for link in links.values() for c in link.rotations}
    shown = {name: np.degrees(v) if name in turning else v for name, v in values.items()}
    write_mot(motion, video.id, video.fps, shown)
    return [model, markers, setup, motion, *write_generic_setups(out, video.id, mass_kg, last_s)]


def _write_model(
    file: Path, video: VideoResult, links: dict[str, Link], rest_m: Float[np.ndarray, "24 3"]
) -> float:
    """Write the performer's model; its mass in kg, by its volume."""
    body = body_model(video.model, video.action, hands=False)
    vertices = body.shape(torch.as_tensor(video.betas)).vertices_rest.numpy()
    owners = [body.joint_names[k] for k in body.weights.argmax(dim=1).tolist()]
    masses = segment_masses(links, vertices, body.faces.numpy(), owners)
    markers: dict[str, Place] = {}
    for joint in JOINT_MARKERS:
        segment = str(SEGMENT_OF_JOINT[joint])
        markers[joint] = segment, links[segment].local_m(rest_m[SMPL_JOINTS.index(joint)])
    of = surface_markers()
    for name, vertex in _surface_vertices(video).items():
        side, segment = name.partition("_")[0], of[name].segment
        segment = segment if segment in links else f"{side}_{segment}"
        markers[name] = segment, links[segment].local_m(vertices[vertex])
    name = video.performer or video.action
    write_osim(file, name, links, masses, markers)
    return sum(mass.mass_kg for mass in masses.values())
