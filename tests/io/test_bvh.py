"""BVH files read back by a parser of their own: the joints are ours, the angles go on smoothly."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.io.writers.bvh import bvh_text, euler_zyx_deg, write_bvh
from imocap_core.io.writers.motion_clip import upright_rest
from tests.io.made_clips import made_clip


@dataclass
class Bone:
    """One block of the hierarchy."""

    name: str
    parent: int
    offset: np.ndarray
    channels: list[str] = field(default_factory=list)


def parse(text: str) -> tuple[list[Bone], float, np.ndarray]:
    """Bones (end sites too), seconds a frame, and the channels (T, C): by tokens, as BVH has it."""
    tokens = iter(text.split())
    bones: list[Bone] = []
    open_: list[int] = []
    for token in tokens:
        if token in ("ROOT", "JOINT", "End"):
            name = next(tokens)
            bones.append(Bone(name, open_[-1] if open_ else -1, np.zeros(3)))
        elif token == "{":
            open_.append(len(bones) - 1)
        elif token == "}":
            open_.pop()
        elif token == "OFFSET":
            bones[-1].offset = np.array([float(next(tokens)) for _ in range(3)])
        elif token == "CHANNELS":
            bones[-1].channels = [next(tokens) for _ in range(int(next(tokens)))]
        elif token == "MOTION":
            break
    assert not open_
    assert [next(tokens) for _ in range(1)] == ["Frames:"]
    frames = int(next(tokens))
    assert [next(tokens) for _ in range(2)] == ["Frame", "Time:"]
    step = float(next(tokens))
    numbers = np.array([float(x) for x in tokens])
    return bones, step, numbers.reshape(frames, -1)


def positions_of(bones: list[Bone], row: np.ndarray) -> dict[str, np.ndarray]:
    """World positions in one frame: every channel applied in its order, from the root down."""
    world: list[tuple[np.ndarray, np.ndarray]] = []
    column = 0
    for bone in bones:
        R, shift = np.eye(3), bone.offset.copy()
        for channel in bone.channels:
            axis = "XYZ".index(channel[0])
            if channel.endswith("position"):
                shift[axis] += row[column]
            else:
                R = R @ Rotation.from_euler(channel[0], row[column], degrees=True).as_matrix()
            column += 1
        R_up, place_up = world[bone.parent] if bone.parent >= 0 else (np.eye(3), np.zeros(3))
        world.append((R_up @ R, place_up + R_up @ shift))
    assert column == len(row)
    return {b.name: w[1] for b, w in zip(bones, world, strict=True) if b.name != "Site"}


@pytest.mark.parametrize("hands", [False, True])
@pytest.mark.parametrize("up", ["y", "z"])
def test_joints_come_back(hands: bool, up: str) -> None:
    clip = made_clip(hands=hands).clip
    bones, step, rows = parse(bvh_text(upright_rest(clip, up)))
    assert step == pytest.approx(1 / clip.fps, abs=1e-9)
    assert len(rows) == len(clip.frames)
    for t, row in enumerate(rows):
        positions = positions_of(bones, row)
        assert set(positions) == set(clip.joint_names)
        theirs = np.array([positions[name] for name in clip.joint_names])
        assert 1000 * np.abs(theirs - clip.joints[t]).max() < 0.02  # millimetres


def test_the_tree_is_smpls_and_ends_in_sites() -> None:
    clip = made_clip().clip
    bones, _, _ = parse(bvh_text(clip))
    named = [b for b in bones if b.name != "Site"]
    assert {b.name: bones[b.parent].name for b in named[1:]} == {
        name: clip.joint_names[parent]
        for name, parent in zip(clip.joint_names[1:], clip.parents[1:], strict=True)
    }
    assert sum(b.name == "Site" for b in bones) == len(clip.tips) == 5
    assert [len(b.channels) for b in named] == [6] + [3] * 23


def test_angles_go_on_without_jumps() -> None:
    """Through the pole of the middle angle and over half a turn."""
    t = np.linspace(0, 1, 200)
    path = Rotation.from_euler("ZYX", np.stack([400 * t, 170 * t, -300 * t], 1), degrees=True)
    angles = euler_zyx_deg(path.as_matrix()[:, None])[:, 0]
    back = Rotation.from_euler("ZYX", angles, degrees=True)
    assert (back.inv() * path).magnitude().max() < 1e-6
    assert np.abs(np.diff(angles, axis=0)).max() < 5.0


def test_the_same_clip_gives_the_same_bytes(tmp_path: Path) -> None:
    clip = made_clip().clip
    write_bvh(tmp_path / "a.bvh", clip)
    write_bvh(tmp_path / "b.bvh", clip)
    assert (tmp_path / "a.bvh").read_bytes() == (tmp_path / "b.bvh").read_bytes()
    assert b"\r" not in (tmp_path / "a.bvh").read_bytes()
