"""Put exported motions onto a humanoid robot in MuJoCo, and measure what the robot would suffer.

    pip install mujoco mink daqp
    imocap run --name serve VIDEOS
    imocap export serve --format bvh --names lafan1 --mean --out many
    imocap run --name alone VIDEO
    imocap export alone --format bvh --names lafan1 --out one
    MUJOCO_GL=egl python examples/retarget_robot.py many/mean.bvh one/*.bvh --out robot \\
        --picture robot.png

Each FILE is a BVH with LAFAN1's names: of the mean performance of many clips, and of one clip
alone, to compare. The robot is a small one of this example's own: 23 hinges with limits, legs of
0.7 m. Bones point where the performer's do, the path is scaled by the legs' length, and inverse
kinematics (mink) keeps within the joints' limits. OUT gets NAME.npz with `qpos` (T, 30), `fps`, and
humanoid.xml.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import mink
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

THIGH, SHANK, ANKLE, UPPER_ARM, FOREARM, HAND = 0.34, 0.34, 0.06, 0.24, 0.24, 0.04  # metres
SOLE_X, SOLE_Y = (-0.05, 0.13), (-0.04, 0.04)
NEAR_M, AT_LIMIT_RAD = 0.02, 0.01
STEPS, DT = 8, 0.1  # of inverse kinematics in a frame
Z_UP = Rotation.from_euler("x", 90, degrees=True)  # of a world with y up
# What a robot's link, x ahead, y left, z up with its limbs hanging, is against LAFAN1's joint.
TRUNK = Rotation.from_matrix([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
FOOT = Rotation.from_matrix([[1, 0, 0], [0, 0, 1], [0, -1, 0]])


@dataclass(frozen=True)
class Motion:
    """Joints by name: places (T, 3) metres and rotations, world with z up."""

    name: str
    fps: float
    places: dict[str, np.ndarray]
    turns: dict[str, Rotation]


def main() -> None:
    """Read, retarget, measure, save."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("files", type=Path, nargs="+", metavar="FILE")
    arguments.add_argument("--out", type=Path, required=True)
    arguments.add_argument("--picture", type=Path, help="a PNG of each robot at five moments")
    given = arguments.parse_args()
    model = mujoco.MjModel.from_xml_string(humanoid())
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "humanoid.xml").write_text(humanoid())
    rows, robots = [], []
    for file in given.files:
        motion = read_bvh(file)
        qpos = retarget(model, motion)
        np.savez(given.out / f"{file.stem}.npz", qpos=qpos, fps=motion.fps)
        rows.append((file, measure(model, qpos, motion.fps)))
        robots.append(qpos)
    print(table(rows))
    if given.picture is not None:
        draw(given.picture, model, robots)


def read_bvh(file: Path) -> Motion:
    """A BVH file in centimetres with y up, by forward kinematics."""
    text, _, numbers = file.read_text().partition("MOTION")
    names, parents, offsets, channels = read_tree(text.split())
    _, _, _, _, step, *values = numbers.split()  # Frames: N Frame Time: step
    rows = np.array(values, float).reshape(-1, sum(len(kinds) for kinds in channels.values()))
    if "LeftUpLeg" not in names:
        raise SystemExit(f"{file}: no joint LeftUpLeg; export it with --names lafan1")
    places: dict[str, np.ndarray] = {}
    turns: dict[str, Rotation] = {}
    column = 0
    for name, kinds in channels.items():
        place, turn = np.tile(offsets[name], (len(rows), 1)), Rotation.identity(len(rows))
        for kind in kinds:
            if kind.endswith("position"):
                place[:, "XYZ".index(kind[0])] += rows[:, column]
            else:
                turn = turn * Rotation.from_euler(kind[0], rows[:, [column]], degrees=True)
            column += 1
        above = parents[name]
        base = Z_UP if above is None else turns[above]
        start = 0.0 if above is None else places[above]
        places[name], turns[name] = start + base.apply(place / 100), base * turn
    return Motion(file.stem, 1.0 / float(step), places, turns)


def read_tree(
    words: list[str],
) -> tuple[list[str], dict[str, str | None], dict[str, list[float]], dict[str, list[str]]]:
    """Names, and by name parent, offset and channels; the ends of bones have none."""
    names: list[str] = []
    parents, offsets, channels = {}, {}, {}
    open_: list[str] = []
    for n, word in enumerate(words):
        if word in ("ROOT", "JOINT", "End"):
            names.append(words[n + 1] if word != "End" else f"end of {names[-1]}")
            parents[names[-1]] = open_[-1] if open_ else None
        elif word == "{":
            open_.append(names[-1])
        elif word == "}":
            open_.pop()
        elif word == "OFFSET":
            offsets[open_[-1]] = [float(x) for x in words[n + 1 : n + 4]]
        elif word == "CHANNELS":
            channels[open_[-1]] = words[n + 2 : n + 2 + int(words[n + 1])]
    return names, parents, offsets, channels


def humanoid() -> str:
    """The robot, MJCF: x ahead, y left, z up; all angles 0 with straight legs and hanging arms."""

    def hinge(name: str, axis: str, low: float, high: float) -> str:
        return f'<joint name="{name}" axis="{axis}" range="{low} {high}"/>'

    def limb(size: float, length: float) -> str:
        return f'<geom type="capsule" size="{size}" fromto="0 0 0 0 0 {-length}"/>'

    legs = arms = ""
    for side, y in (("left", 1), ("right", -1)):
        roll, yaw = sorted((-0.5 * y, 0.9 * y)), sorted((-0.8 * y, 0.8 * y))
        soles = "".join(
            f'<site name="{side}_sole{n}" pos="{SOLE_X[n // 2]} {SOLE_Y[n % 2]} {-ANKLE}"/>'
            for n in range(4)
        )
        legs += f"""
    <body name="{side}_thigh" pos="0 {0.1 * y} -0.06">
      {hinge(f"{side}_hip_pitch", "0 1 0", -2.4, 0.8)}{hinge(f"{side}_hip_roll", "1 0 0", *roll)}
      {hinge(f"{side}_hip_yaw", "0 0 1", *yaw)}{limb(0.05, THIGH)}
      <body name="{side}_shank" pos="0 0 {-THIGH}">
        {hinge(f"{side}_knee", "0 1 0", 0, 2.5)}{limb(0.04, SHANK)}
        <body name="{side}_foot" pos="0 0 {-SHANK}">
          {hinge(f"{side}_ankle_pitch", "0 1 0", -0.9, 0.7)}
          {hinge(f"{side}_ankle_roll", "1 0 0", -0.4, 0.4)}
          <geom type="box" size="0.09 0.04 0.015" pos="0.04 0 {-ANKLE + 0.015}"/>{soles}
    </body></body></body>"""
        raised = sorted((-0.3 * y, 2.9 * y))
        arms += f"""
      <body name="{side}_upper_arm" pos="0 {0.19 * y} 0.36">
        {hinge(f"{side}_shoulder_pitch", "0 1 0", -3.0, 1.0)}
        {hinge(f"{side}_shoulder_roll", "1 0 0", *raised)}
        {hinge(f"{side}_shoulder_yaw", "0 0 1", -1.6, 1.6)}{limb(0.035, UPPER_ARM)}
        <body name="{side}_forearm" pos="0 0 {-UPPER_ARM}">
          {hinge(f"{side}_elbow", "0 1 0", -2.4, 0)}{limb(0.03, FOREARM)}
          <body name="{side}_hand" pos="0 0 {-FOREARM}"><geom type="sphere" size="{HAND}"/>
      </body></body></body>"""
    return f"""<mujoco model="humanoid">
  <compiler angle="radian"/><visual><headlight ambient=".45 .45 .45"/></visual>
  <asset><texture type="skybox" builtin="flat" rgb1="1 1 1" rgb2="1 1 1" width="64" height="64"/>
  <texture name="t" type="2d" builtin="checker" rgb1=".8 .8 .8" rgb2=".7 .7 .7" width="64"
    height="64"/><material name="floor" texture="t" texrepeat="8 8"/></asset>
  <default><geom contype="0" conaffinity="0" density="900" rgba=".25 .45 .7 1"/></default>
  <worldbody>
  <light pos="0 -2 4" dir="0 .4 -1" diffuse=".9 .9 .9"/>
  <geom type="plane" size="4 4 .1" material="floor" rgba="1 1 1 1"/>
  <body name="pelvis" pos="0 0 0.8"><freejoint/><geom type="box" size="0.07 0.11 0.06"/>
    <body name="torso" pos="0 0 0.08">
      {hinge("waist_yaw", "0 0 1", -1.2, 1.2)}{hinge("waist_roll", "1 0 0", -0.5, 0.5)}
      {hinge("waist_pitch", "0 1 0", -0.4, 1.2)}
      <geom type="box" size="0.07 0.13 0.19" pos="0 0 0.19"/>
      <geom type="sphere" size="0.09" pos="0 0 0.5"/>{arms}
    </body>{legs}
  </body></worldbody>
</mujoco>"""


def retarget(model: mujoco.MjModel, motion: Motion) -> np.ndarray:
    """Generalised positions (T, 30) of the robot: inverse kinematics frame by frame."""
    configuration = mink.Configuration(model)
    configuration.update(model.key_qpos[0] if model.nkey else model.qpos0)
    tasks = {"pelvis": mink.FrameTask("pelvis", "body", 10.0, 5.0)}
    tasks["torso"] = mink.FrameTask("torso", "body", 0.0, 1.0)
    for side in ("left", "right"):
        for link, place, turn in (
            ("shank", 1.0, 0.0), ("foot", 20.0, 2.0), ("forearm", 1.0, 0.0), ("hand", 3.0, 0.0)
        ):  # fmt: skip
            tasks[f"{side}_{link}"] = mink.FrameTask(f"{side}_{link}", "body", place, turn)
    posture = mink.PostureTask(model, 0.02)
    posture.set_target(model.qpos0)
    limits = [mink.ConfigurationLimit(model)]
    rows = []
    targets = targets_of(motion)
    for t in range(len(motion.places["Hips"])):
        for link, task in tasks.items():
            place, turn = targets[link]
            task.set_target(mink.SE3.from_matrix(pose(turn[t], place[t])))
        for _ in range(STEPS if t else 20 * STEPS):
            speed = mink.solve_ik(
                configuration, [*tasks.values(), posture], DT, "daqp", damping=1e-2, limits=limits
            )
            configuration.integrate_inplace(speed, DT)
        rows.append(configuration.q.copy())
    return on_floor(model, np.array(rows))


def pose(turn: Rotation, place: np.ndarray) -> np.ndarray:
    """A homogeneous matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), place
    return matrix


def targets_of(motion: Motion) -> dict[str, tuple[np.ndarray, Rotation]]:
    """Place (T, 3) and rotation of each link: the robot's bones, directed as the performer's."""
    human = motion.places
    legs = [
        np.linalg.norm(human[b] - human[a], axis=1).mean()
        for side in ("Left", "Right")
        for a, b in ((f"{side}UpLeg", f"{side}Leg"), (f"{side}Leg", f"{side}Foot"))
    ]
    scale = (THIGH + SHANK) / (0.5 * sum(legs))
    hips, torso = motion.turns["Hips"] * TRUNK, motion.turns["Spine2"] * TRUNK
    pelvis = scale * human["Hips"]
    targets = {"pelvis": (pelvis, hips), "torso": (pelvis, torso)}
    chest = pelvis + hips.apply([0, 0, 0.08])
    for side, y in (("left", 1), ("right", -1)):
        name = side.capitalize()
        hip, shoulder = (
            pelvis + hips.apply([0, 0.1 * y, -0.06]),
            chest + torso.apply([0, 0.19 * y, 0.36]),
        )
        foot = motion.turns[f"{name}Toe"] * FOOT
        for start, joints, lengths, links in (
            (hip, ("UpLeg", "Leg", "Foot"), (THIGH, SHANK), ("shank", "foot")),
            (shoulder, ("Arm", "ForeArm", "Hand"), (UPPER_ARM, FOREARM), ("forearm", "hand")),
        ):
            for k in range(2):
                bone = human[name + joints[k + 1]] - human[name + joints[k]]
                start = start + lengths[k] * bone / np.linalg.norm(bone, axis=1, keepdims=True)
                targets[f"{side}_{links[k]}"] = (start, foot)
    return targets


def soles(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """Corners of both soles (T, 2, 4, 3), metres."""
    data = mujoco.MjData(model)
    ids = [model.site(f"{side}_sole{n}").id for side in ("left", "right") for n in range(4)]
    corners = []
    for q in qpos:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        corners.append(data.site_xpos[ids].reshape(2, 4, 3).copy())
    return np.array(corners)


def lowest_hand(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """Height (T,) of the lower hand's underside, metres."""
    data = mujoco.MjData(model)
    ids = [model.body(f"{side}_hand").id for side in ("left", "right")]
    heights = []
    for q in qpos:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        heights.append(data.xpos[ids, 2].min() - HAND)
    return np.array(heights)


def on_floor(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """The same at the height at which the lower sole is on the floor in the median frame."""
    lowest = soles(model, qpos)[..., 2].min(axis=(1, 2))
    shifted = qpos.copy()
    shifted[:, 2] -= np.median(lowest)
    return shifted


def measure(model: mujoco.MjModel, qpos: np.ndarray, fps: float) -> dict[str, float]:
    """What a controller would have to mend, by the table's columns."""
    corners, hands = soles(model, qpos), lowest_hand(model, qpos)
    depth = np.maximum(-corners[..., 2].min(axis=(1, 2)), 0)
    middle = corners.mean(axis=2)
    low = corners[..., 2].mean(axis=2) < NEAR_M
    planted = low[1:] & low[:-1]
    speed = np.linalg.norm(np.diff(middle[..., :2], axis=0), axis=-1) * fps
    angles, ranges = qpos[:, 7:], model.jnt_range[1:]
    at_limit = (angles < ranges[:, 0] + AT_LIMIT_RAD) | (angles > ranges[:, 1] - AT_LIMIT_RAD)
    jerk = np.diff(angles, 3, axis=0) * fps**3
    return {
        "soles below the floor, mean mm": 1000 * depth.mean(),
        "largest, mm": 1000 * depth.max(),
        "hands below, mean mm": 1000 * np.maximum(-hands, 0).mean(),
        "planted feet, mm/s": 1000 * speed[planted].mean() if planted.any() else np.nan,
        "frames planted, %": 100 * low.any(axis=1).mean(),
        "at a limit, % of angles": 100 * at_limit.mean(),
        "jerk, rad/s^3": np.sqrt((jerk**2).mean()),
    }


def table(rows: list[tuple[Path, dict[str, float]]]) -> str:
    """Markdown."""
    columns = list(rows[0][1])
    lines = ["| motion | " + " | ".join(columns) + " |", "|---|" + "---:|" * len(columns)]
    for file, numbers in rows:
        lines.append(f"| {file} | " + " | ".join(f"{numbers[c]:.1f}" for c in columns) + " |")
    return "\n".join(lines)


def draw(file: Path, model: mujoco.MjModel, robots: list[np.ndarray]) -> None:
    """Each robot at five moments in a row; needs OpenGL (EGL or OSMesa without a display)."""
    import cv2

    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation, camera.distance = 130, -12, 2.6
    data, rows = mujoco.MjData(model), []
    with mujoco.Renderer(model, 320, 320) as renderer:
        for qpos in robots:
            row = []
            for t in np.linspace(0, len(qpos) - 1, 5).round().astype(int):
                data.qpos[:] = qpos[t]
                mujoco.mj_kinematics(model, data)
                camera.lookat[:] = [*qpos[t, :2], 0.6]
                renderer.update_scene(data, camera)
                row.append(renderer.render().copy())
            rows.append(np.hstack(row))
    cv2.imwrite(str(file), np.vstack(rows)[..., ::-1])


if __name__ == "__main__":
    main()
