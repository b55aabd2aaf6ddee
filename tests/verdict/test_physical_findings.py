"""A rolled camera, soles off the floor, impossible speeds, and arms inside of what hides them."""

from __future__ import annotations

import numpy as np
import pytest

from imocap_core.artifacts.schemas import GroundPlane, SmplBa
from imocap_core.body.layouts import layout_names
from imocap_core.camera.gravity import sole_heights_m
from imocap_core.camera.ground_plane import Ground
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.diagnostics.bodies import (
    OFF_FLOOR_MM,
    ROLLED_DEG,
    TILT_SD_DEG,
    floor_findings,
    speed_findings,
    up_findings,
)
from imocap_core.diagnostics.contradictions import behind_findings, behind_trunk_m
from tests.report.made import FPS, Made


def standing(made: Made, roll_deg: float = 0.0, sunk_mm: float = 0.0, sd: float = 2.0) -> SmplBa:
    """The made motion on a floor; up leans so far to the first picture's right."""
    motion, roll = made.refined.motion, np.radians(roll_deg)
    level = Ground(np.array([0.0, -1.0, 0.0]), np.zeros(3), sd, 5.0)
    soles = np.median([sole_heights_m(v.joints, level).min() for v in motion.videos])
    plane = GroundPlane(
        up=np.array([np.sin(roll), -np.cos(roll), 0.0]),
        origin=level.up * (soles + sunk_mm / 1000),
        tilt_sd_deg=sd,
        height_sd_mm=5.0,
    )
    R = [camera.model_copy(update={"R": np.eye(3)}) for camera in motion.cameras]
    return motion.model_copy(update={"ground": plane, "cameras": R})


@pytest.mark.parametrize("roll", [-80.0, ROLLED_DEG - 1, ROLLED_DEG + 1])
def test_a_rolled_camera_makes_up_doubtful(roll: float) -> None:
    made = Made(2)
    motion, sync = standing(made, roll_deg=roll), made.refined.sync
    findings = up_findings(motion, sync, made.camera_motion.videos)
    assert [f.kind for f in findings] == (["up"] if abs(roll) > ROLLED_DEG else [])
    if findings:
        assert f"rolled by {abs(roll):.0f} degrees" in findings[0].brief


def test_an_uncertain_up_is_doubtful() -> None:
    made = Made(2)
    cameras, sync = made.camera_motion.videos, made.refined.sync
    assert not up_findings(standing(made, sd=TILT_SD_DEG - 1), sync, cameras)
    (finding,) = up_findings(standing(made, sd=TILT_SD_DEG + 1), sync, cameras)
    assert "uncertain" in finding.brief


@pytest.mark.parametrize(
    ("sunk_mm", "brief"),
    [(OFF_FLOOR_MM / 2, None), (300.0, "soles below the floor"), (-300.0, "soles above the floor")],
)
def test_soles_off_the_floor_are_named(sunk_mm: float, brief: str | None) -> None:
    made = Made(1)
    findings = floor_findings(standing(made, sunk_mm=sunk_mm), made.refined.sync)
    assert [f.brief for f in findings] == ([] if brief is None else [brief])


def test_only_what_nobody_does_is_too_fast() -> None:
    made = Made(1, frames=30)
    videos = {v.id: v for v in made.keypoints.videos}
    for speed, named in ((25.0, False), (60.0, True)):
        joints = made.final[0].joints.copy()
        joints[15:, SMPL_JOINTS.index("left_wrist"), 0] += speed * 2 / FPS
        (motion,) = [made.final[0].model_copy(update={"joints": joints})]
        findings = speed_findings([motion], videos)
        assert bool(findings) == named
        assert all(f.first_frame <= 15 <= f.last_frame for f in findings)


def facing_body(wrist: tuple[float, float, float]) -> np.ndarray:
    """(1, 24, 3) a trunk that faces a camera 3 m away, and a wrist."""
    joints = np.zeros((1, 24, 3)) + [0.0, 0.0, 3.0]
    for side, x in (("left", 0.2), ("right", -0.2)):
        joints[0, SMPL_JOINTS.index(f"{side}_shoulder")] = x, -0.5, 3.0
        joints[0, SMPL_JOINTS.index(f"{side}_hip")] = x / 2, 0.0, 3.0
    joints[0, SMPL_JOINTS.index("left_wrist")] = wrist
    return joints


@pytest.mark.parametrize(
    ("wrist", "behind"),
    [((0, -0.3, 3.3), 0.3), ((0, -0.3, 2.7), 0.0), ((0.5, -0.3, 3.3), 0.0)],
)
def test_a_wrist_is_hidden_behind_the_trunk_only(
    wrist: tuple[float, float, float], behind: float
) -> None:
    depth = behind_trunk_m(facing_body(wrist), SMPL_JOINTS.index("left_wrist"))
    assert depth[0] == pytest.approx(behind, abs=0.01)


@pytest.mark.parametrize(
    ("layout", "confidence", "named"),
    [("blazepose33", 0.9, True), ("blazepose33", 0.4, False), ("body25", 0.9, False)],
)
def test_an_arm_seen_clearly_is_not_behind_the_trunk(
    layout: str, confidence: float, named: bool
) -> None:
    made = Made(1)
    video = made.keypoints.videos[0].model_copy(update={"layout": layout})
    names = layout_names(layout)
    seen = np.zeros((len(video.frames), len(names)))
    seen[:, names.index("left_wrist")] = confidence
    joints = np.repeat(facing_body((0, -0.3, 3.3)), len(video.frames), axis=0)
    body = made.final[0].model_copy(update={"joints": joints})
    motion = made.refined.motion.model_copy(update={"videos": [body]})
    findings = behind_findings(motion, {video.id: video.model_copy(update={"confidence": seen})})
    assert [f.brief for f in findings] == (["left arm wrong in depth"] if named else [])
