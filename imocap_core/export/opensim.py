"""Files for OpenSim: per video a model of the performer, markers, a setup and a motion.

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

from imocap_core.biomechanics.linkage import Link, linkage, segment_of_joint
from imocap_core.biomechanics.linkage_motion import linkage_coordinates, to_ground
from imocap_core.biomechanics.markers import surface_markers
from imocap_core.biomechanics.segment_masses import segment_masses
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.export.laboratory import MM, surface_points_m, surface_vertices
from imocap_core.io.writers.opensim_files import write_ik_setup, write_mot
from imocap_core.io.writers.opensim_generic import write_generic_markers, write_generic_setups
from imocap_core.io.writers.osim import Place, write_osim
from imocap_core.io.writers.trc import write_markers
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult
from imocap_core.result.video_angles import body_rotations, rest_joints_m
from imocap_core.result.video_body import body_model_of

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
    rest_m = rest_joints_m(video)
    links = linkage(rest_m)
    mass_kg = _write_model(model, video, links, rest_m)
    paths_mm = marker_paths_mm(video)
    start = round(float(video.frames[0]))
    write_markers(markers, paths_mm, video.fps, start)
    last_s = (len(video) - 1) / video.fps
    write_ik_setup(setup, video.id, paths_mm, last_s)
    values = linkage_coordinates(links, body_rotations(video), video.body_joints, rest_m)
    turning = {c.name for link in links.values() for c in link.rotations}
    shown = {name: np.degrees(v) if name in turning else v for name, v in values.items()}
    write_mot(motion, video.id, video.fps, shown)
    return [model, markers, setup, motion, *write_generic_setups(out, video.id, mass_kg, last_s)]


def marker_paths_mm(video: VideoResult) -> dict[str, Float[np.ndarray, "T 3"]]:
    """Joint centres and surface markers over time, millimetres, in the axes of OpenSim's ground."""
    joints = {j: video.body_joints[:, SMPL_JOINTS.index(j)] for j in JOINT_MARKERS}
    return {n: MM * to_ground(p) for n, p in (joints | surface_points_m(video)).items()}


def _write_model(
    file: Path, video: VideoResult, links: dict[str, Link], rest_m: Float[np.ndarray, "24 3"]
) -> float:
    """Write the performer's model; its mass in kg, by its volume."""
    body = body_model_of(video, hands=False)
    vertices = body.shape(torch.as_tensor(video.betas)).vertices_rest.numpy()
    owners = [body.joint_names[k] for k in body.weights.argmax(dim=1).tolist()]
    masses = segment_masses(links, vertices, body.faces.numpy(), owners)
    markers: dict[str, Place] = {}
    for joint in JOINT_MARKERS:
        segment = str(SEGMENT_OF_JOINT[joint])
        markers[joint] = segment, links[segment].local_m(rest_m[SMPL_JOINTS.index(joint)])
    of = surface_markers()
    for name, vertex in surface_vertices(video).items():
        side, segment = name.partition("_")[0], of[name].segment
        segment = segment if segment in links else f"{side}_{segment}"
        markers[name] = segment, links[segment].local_m(vertices[vertex])
    name = video.performer or video.action
    write_osim(file, name, links, masses, markers)
    return sum(mass.mass_kg for mass in masses.values())
