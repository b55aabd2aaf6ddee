"""Put exported motions onto Unitree's G1 in MuJoCo, and measure what the robot would suffer.

    pip install mujoco mink daqp robosuite-models
    imocap run --name serve VIDEOS
    imocap export serve --format bvh --names lafan1 --mean --out many
    imocap run --name alone VIDEO
    imocap export alone --format bvh --names lafan1 --out one
    MUJOCO_GL=egl python examples/retarget_robot.py many/mean.bvh one/*.bvh --out robot \\
        --picture robot.png

Each FILE is a BVH with LAFAN1's names: of the mean performance of many clips, and of one clip
alone, to compare. The robot has 23 hinges with limits and no hinge in the waist but a turning one;
its model is in the package robosuite-models. Knees and elbows point where the performer's do, the
path and the ankles are the performer's, scaled by the legs' length, and inverse kinematics (mink)
keeps within the joints' limits. OUT gets NAME.npz with `qpos` (T, 30) and `fps`.
"""

from __future__ import annotations

import argparse
import importlib.util
import itertools
from dataclasses import dataclass
from pathlib import Path

import mink
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

MODEL = "assets/robots/g1/robot.xml"  # in the package robosuite_models
PELVIS, TORSO, SIDES = "pelvis", "torso_link", {"l": "Left", "r": "Right"}
# The robot's bodies at the joints of a limb, and LAFAN1's joints there.
LEG = ("hip_roll_link", "knee_link", "ankle_pitch_link"), ("UpLeg", "Leg", "Foot")
ARM = ("shoulder_roll_link", "elbow_pitch_link", "elbow_roll_link"), ("Arm", "ForeArm", "Hand")
FOOT_LINK = "ankle_roll_link"
WEIGHTS = {  # of place and of rotation, in inverse kinematics
    PELVIS: (10.0, 1.0), TORSO: (0.0, 5.0), "knee_link": (1.0, 0.0),
    "ankle_pitch_link": (20.0, 0.0), FOOT_LINK: (0.0, 2.0),
    "elbow_pitch_link": (3.0, 0.0), "elbow_roll_link": (3.0, 0.0),
}  # fmt: skip
NEAR_M, AT_LIMIT_RAD = 0.02, 0.01
STEPS, DT, DAMPING = 8, 0.1, 0.3  # of inverse kinematics in a frame
# Towards all angles 0; of the shoulders' roll more, or raised arms end at its limit.
POSTURE, SHOULDER_ROLL = 0.02, 0.2
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
    model = load_robot()
    given.out.mkdir(parents=True, exist_ok=True)
    motions = [read_bvh(file) for file in given.files]
    robots = [retarget(model, motion) for motion in motions]
    for motion, qpos in zip(motions, robots, strict=True):
        np.savez(given.out / f"{motion.name}.npz", qpos=qpos, fps=motion.fps)
    print(table({m.name: measure(model, q, m.fps) for m, q in zip(motions, robots, strict=True)}))
    if given.picture is not None:
        draw(given.picture, model, robots)


def load_robot() -> mujoco.MjModel:
    """The robot as its package has it, on a floor with light."""
    package = importlib.util.find_spec("robosuite_models")
    if package is None or package.origin is None:
        raise SystemExit("the robot's model is missing: pip install robosuite-models")
    spec = mujoco.MjSpec.from_file(str(Path(package.origin).parent / MODEL))
    plane = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [4, 4, 0.1], "rgba": [1, 1, 1, 1]}
    spec.worldbody.add_geom(name="floor", **plane)
    spec.worldbody.add_light(pos=[0, -2, 4], dir=[0, 0.4, -1])
    sky = {"type": mujoco.mjtTexture.mjTEXTURE_SKYBOX, "builtin": mujoco.mjtBuiltin.mjBUILTIN_FLAT}
    spec.add_texture(**sky, rgb1=[1, 1, 1], rgb2=[1, 1, 1], width=64, height=64)
    spec.visual.headlight.ambient = [0.4, 0.4, 0.4]
    return spec.compile()


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


def retarget(model: mujoco.MjModel, motion: Motion) -> np.ndarray:
    """Generalised positions (T, 30) of the robot: inverse kinematics frame by frame."""
    targets = targets_of(model, motion)
    start, (place, turn) = model.qpos0.copy(), targets[PELVIS]
    start[:3] = place[0] - turn[0].apply(at_rest(model)[PELVIS])
    start[3:7] = turn[0].as_quat(scalar_first=True)
    configuration = mink.Configuration(model, start)
    tasks = {
        link: mink.FrameTask(
            link, "body", *WEIGHTS[link.removeprefix("l_").removeprefix("r_")], lm_damping=DAMPING
        )
        for link in targets
    }
    costs = np.full(model.nv, POSTURE)
    costs[[model.joint(f"{side}_shoulder_roll_joint").dofadr[0] for side in SIDES]] = SHOULDER_ROLL
    posture = mink.PostureTask(model, costs)
    posture.set_target(model.qpos0)
    ends = [model.body(f"{side}_{link}").id for side in SIDES for link in (ARM[0][2], FOOT_LINK)]
    solid = np.flatnonzero(np.isin(model.geom_bodyid, ends) & (model.geom_contype > 0))
    floor = mink.CollisionAvoidanceLimit(model, [(solid.tolist(), ["floor"])])
    limits = [mink.ConfigurationLimit(model), floor]
    rows = []
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
    return np.array(rows)


def pose(turn: Rotation, place: np.ndarray) -> np.ndarray:
    """A homogeneous matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), place
    return matrix


def targets_of(model: mujoco.MjModel, motion: Motion) -> dict[str, tuple[np.ndarray, Rotation]]:
    """Place (T, 3) and rotation of each link: the robot's bones, directed as the performer's."""
    human, rest = on_robots_scale(model, motion), at_rest(model)
    hips = motion.turns["Hips"] * TRUNK
    above = hips.apply((rest[PELVIS] - rest[f"l_{LEG[0][0]}"]) * [1, 0, 1])  # the hips' middle
    pelvis = 0.5 * (human["LeftUpLeg"] + human["RightUpLeg"]) + above
    torso = motion.turns["Spine2"] * TRUNK
    targets = {PELVIS: (pelvis, hips), TORSO: (pelvis, torso)}
    for side, name in SIDES.items():
        foot = motion.turns[f"{name}Toe"] * FOOT
        for (links, joints), trunk in ((LEG, hips), (ARM, torso)):
            link = pelvis + trunk.apply(rest[f"{side}_{links[0]}"] - rest[PELVIS])
            for k in (1, 2):
                bone = human[name + joints[k]] - human[name + joints[k - 1]]
                length = np.linalg.norm(rest[f"{side}_{links[k]}"] - rest[f"{side}_{links[k - 1]}"])
                link = link + length * bone / np.linalg.norm(bone, axis=1, keepdims=True)
                targets[f"{side}_{links[k]}"] = (link, foot)
        targets[f"{side}_{LEG[0][2]}"] = (human[f"{name}Foot"], foot)
        targets[f"{side}_{FOOT_LINK}"] = (pelvis, foot)
    return targets


def on_robots_scale(model: mujoco.MjModel, motion: Motion) -> dict[str, np.ndarray]:
    """The performer's joints with legs as long as the robot's, standing on its soles."""
    human, rest = motion.places, at_rest(model)
    legs = [
        np.linalg.norm(human[name + b] - human[name + a], axis=1).mean()
        for name in SIDES.values()
        for a, b in itertools.pairwise(LEG[1])
    ]
    hip, ankle = rest[f"l_{LEG[0][0]}"], rest[f"l_{LEG[0][2]}"]
    scale = np.linalg.norm(hip - ankle) / (0.5 * sum(legs))
    lower = np.minimum(human["LeftFoot"][:, 2], human["RightFoot"][:, 2])
    sole = soles(model, model.qpos0[None])[..., 2].min()
    lift = ankle[2] - sole - scale * np.median(lower)
    return {name: scale * place + [0, 0, lift] for name, place in human.items()}


def at_rest(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Places of the bodies with all angles 0."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return {model.body(b).name: data.xpos[b].copy() for b in range(model.nbody)}


def soles(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """Corners of both soles (T, 2, 4, 3), metres: the spheres of the feet."""
    data, sphere = mujoco.MjData(model), mujoco.mjtGeom.mjGEOM_SPHERE
    feet = [model.body(f"{side}_{FOOT_LINK}").id for side in SIDES]
    ids = [np.flatnonzero((model.geom_bodyid == f) & (model.geom_type == sphere)) for f in feet]
    corners = []
    for q in qpos:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        corners.append(data.geom_xpos[np.array(ids)])
    return np.array(corners)


def below_floor(model: mujoco.MjModel, qpos: np.ndarray) -> np.ndarray:
    """Depth (T,) of the robot's lowest part in the floor, metres; 0 where it only touches it."""
    data, floor = mujoco.MjData(model), model.geom("floor").id
    depths = []
    for q in qpos:
        data.qpos[:] = q
        mujoco.mj_fwdPosition(model, data)
        on_it = (data.contact.geom == floor).any(axis=1)
        depths.append(max(0.0, -data.contact.dist[on_it].min(initial=0.0)))
    return np.array(depths)


def measure(model: mujoco.MjModel, qpos: np.ndarray, fps: float) -> dict[str, float]:
    """What a controller would have to mend, by the table's columns."""
    corners, depth = soles(model, qpos), below_floor(model, qpos)
    middle = corners.mean(axis=2)
    low = corners[..., 2].mean(axis=2) < NEAR_M
    planted = low[1:] & low[:-1]
    speed = np.linalg.norm(np.diff(middle[..., :2], axis=0), axis=-1) * fps
    angles, ranges = qpos[:, 7:], model.jnt_range[1:]
    at_limit = (angles < ranges[:, 0] + AT_LIMIT_RAD) | (angles > ranges[:, 1] - AT_LIMIT_RAD)
    jerk = np.diff(angles, 3, axis=0) * fps**3
    return {
        "below the floor, mean mm": 1000 * depth.mean(),
        "largest, mm": 1000 * depth.max(),
        "planted feet, mm/s": 1000 * speed[planted].mean() if planted.any() else np.nan,
        "frames planted, %": 100 * low.any(axis=1).mean(),
        "at a limit, % of angles": 100 * at_limit.mean(),
        "jerk, rad/s^3": np.sqrt((jerk**2).mean()),
    }


def table(motions: dict[str, dict[str, float]]) -> str:
    """Markdown."""
    columns = list(next(iter(motions.values())))
    lines = ["| motion | " + " | ".join(columns) + " |", "|---|" + "---:|" * len(columns)]
    for name, numbers in motions.items():
        lines.append(f"| {name} | " + " | ".join(f"{numbers[c]:.1f}" for c in columns) + " |")
    return "\n".join(lines)


def draw(file: Path, model: mujoco.MjModel, robots: list[np.ndarray]) -> None:
    """Each robot at five moments in a row; needs OpenGL (EGL or OSMesa without a display)."""
    import cv2

    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation, camera.distance = 130, -12, 2.2
    data, rows = mujoco.MjData(model), []
    with mujoco.Renderer(model, 320, 320) as renderer:
        for qpos in robots:
            row = []
            for t in np.linspace(0, len(qpos) - 1, 5).round().astype(int):
                data.qpos[:] = qpos[t]
                mujoco.mj_kinematics(model, data)
                camera.lookat[:] = [*data.body(TORSO).xpos[:2], 0.45]
                renderer.update_scene(data, camera)
                row.append(renderer.render().copy())
            rows.append(np.hstack(row))
    cv2.imwrite(str(file), np.vstack(rows)[..., ::-1])


if __name__ == "__main__":
    main()
