"""The viewer: one HTML file that holds its program, its data and its pictures; the body in it.

The body in the viewer: one surface per shape, four bones per vertex, and poses per frame. The page
skins the surface itself (web/body.js, web/shaders.js), so a frame costs its angles only.
"""

from __future__ import annotations

import base64
import html
import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from string import Template
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int, Int16
from numpy.typing import ArrayLike

from imocap_core.artifacts.schemas import VideoMotion
from imocap_core.body import Model, Shaped
from imocap_core.body.model import pose_from_rotations, rotations_from_pose, smplh_from_smpl
from imocap_core.camera.gravity import BodyMotion, Extrinsics, to_world
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.result.video import VideoCamera, VideoResult

_ALIGNED = 8
Entry = dict[str, Any]


class Block:
    """Collects arrays; `add` returns what web/data.js turns into a typed array."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: ArrayLike, kind: str) -> Entry:
        """Append an array as little-endian f4, i2, i4, u1, u2 or u4, flat; its entry.

        ValueError when a whole number does not fit the kind.
        """
        given = np.asarray(values).ravel()
        array = given.astype(f"<{kind}")
        if array.dtype.kind in "iu" and not np.array_equal(array, given):
            limits = np.iinfo(array.dtype)
            raise ValueError(
                f"values: expected whole numbers from {limits.min} to {limits.max} for {kind}, "
                f"got {given.min()} to {given.max()}"
            )
        padding = -self._size % _ALIGNED
        self._parts += [bytes(padding), array.tobytes()]
        offset = self._size + padding
        self._size = offset + array.nbytes
        return {"$": kind, "at": offset, "count": len(array)}

    def base64(self) -> str:
        """Everything, deflated, as text for the page."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), 9)).decode("ascii")


def quantised(values: ArrayLike) -> tuple[Int16[np.ndarray, "..."], float]:
    """Finite numbers as 16-bit integers, and the number that 32767 represents.

    The error is at most scale / 65534.
    """
    array = np.asarray(values, dtype=np.float64)
    if not np.isfinite(array).all():
        raise ValueError("values: expected finite numbers, got some that are not")
    scale = float(np.abs(array).max(initial=1e-9))
    return np.round(array / scale * 32767).astype(np.int16), scale


_BONES = 4
_LIGHTNESS = {"skin": 1.0, "hair": 0.42, "shirt": 0.8, "trousers": 0.52, "shoes": 0.3}
_BODY_ANGLES = 3 * SMPL_JOINTS.index("left_hand")  # those that SMPL and SMPL+H share


@dataclass(frozen=True, eq=False)
class ShownMotion:
    """One motion of a video in the level world.

    theta (T, 3 J): axis-angle radians; J as the model's. betas (B,). trans (T, 3), joints
    (T, 24, 3): metres.
    """

    theta: Float[np.ndarray, "T P"]
    betas: Float[np.ndarray, " B"]
    trans: Float[np.ndarray, "T 3"]
    joints: Float[np.ndarray, "T 24 3"]


def final_motion(video: VideoResult, fingers: bool) -> ShownMotion:
    """The motion of a levelled result; with `fingers` in SMPL+H's joints."""
    theta = _with_fingers(video.theta) if fingers and video.hands is None else video.poses
    return ShownMotion(theta, video.betas, video.trans, video.body_joints)


def monocular_motion(motion: VideoMotion, camera: VideoCamera, fingers: bool) -> ShownMotion:
    """The monocular motion of a video, placed by the final camera of a levelled result."""
    placed = to_world(
        BodyMotion(motion.theta, motion.trans, motion.joints), Extrinsics(camera.R, camera.t)
    )
    theta = _with_fingers(placed.theta) if fingers else placed.theta
    return ShownMotion(theta, motion.betas, placed.trans, placed.joints)


def _with_fingers(theta: Float[np.ndarray, "T 72"]) -> Float[np.ndarray, "T 156"]:
    """SMPL's poses in SMPL+H's joints: fingers turn as SMPL's hand joints do."""
    R_local = smplh_from_smpl(rotations_from_pose(torch.as_tensor(theta)))
    fingers = pose_from_rotations(R_local)[:, _BODY_ANGLES:].numpy()
    return np.concatenate([theta[:, :_BODY_ANGLES], fingers], axis=1)


def model_entry(block: Block, model: Model) -> dict[str, object]:
    """Common to all bodies: joint tree, faces, bones and their weights, shades of the parts."""
    bones, weights = strongest_bones(model.weights.numpy())
    return {
        "parents": list(model.parents),
        "joints": [name.replace("_", " ") for name in model.joint_names],
        "head": model.joint_names.index("head"),
        "faces": block.add(model.faces.numpy(), "u2"),
        "bones": block.add(bones, "u1"),
        "weights": block.add(weights, "u2"),
        "shades": block.add(shades(model), "u1"),
    }


def strongest_bones(
    weights: Float[np.ndarray, "V J"],
) -> tuple[Int[np.ndarray, "V 4"], Int[np.ndarray, "V 4"]]:
    """The four strongest bones of each vertex, and their weights of 65535 together: (V, 4) each."""
    bones = np.argsort(-weights, axis=1, kind="stable")[:, :_BONES]
    strongest = np.take_along_axis(weights, bones, axis=1)
    shares = strongest / strongest.sum(axis=1, keepdims=True)
    whole = np.round(65535 * shares).astype(np.int64)
    whole[:, 0] += 65535 - whole.sum(axis=1)  # else the body would move by 1/65535 of its place
    return bones, whole


def shades(model: Model) -> Int[np.ndarray, " V"]:
    """Brightness of each vertex, 0 to 255: the mean over its faces' parts."""
    if model.face_parts is None:
        return np.full(len(model.v_template), 200)
    part = np.array([_LIGHTNESS.get(name, 0.8) for name in model.part_names])
    faces = model.faces.numpy()
    light = np.repeat(part[model.face_parts.numpy()], 3)
    total = np.bincount(faces.ravel(), light, minlength=len(model.v_template))
    count = np.bincount(faces.ravel(), minlength=len(model.v_template))
    return np.round(255 * total / np.maximum(count, 1)).astype(np.int64)


def shape_entry(block: Block, shaped: Shaped) -> dict[str, Entry | float]:
    """The rest surface and rest joints of one shape."""
    rest, scale = quantised(shaped.vertices_rest.numpy())
    return {
        "rest": block.add(rest, "i2"),
        "scale": scale,
        "joints": block.add(shaped.joints_rest.numpy(), "f4"),
    }


def motion_entry(block: Block, motion: ShownMotion) -> dict[str, Entry]:
    """The poses of a motion, frame by frame."""
    return {"local": block.add(motion.theta, "f4"), "trans": block.add(motion.trans, "f4")}


_PACKAGE = "imocap_core.viewer"
SCRIPTS = (
    "math.js",
    "theme.js",
    "data.js",
    "body.js",
    "coarse.js",
    "shaders.js",
    "gl.js",
    "shapes.js",
    "skeleton.js",
    "orbit.js",
    "detail.js",
    "scene.js",
    "pictures.js",
    "cards.js",
    "verdict.js",
    "plots.js",
    "curves.js",
    "actors.js",
    "measure.js",
    "labels.js",
    "address.js",
    "snapshot.js",
    "tools.js",
    "transport.js",
    "chooser.js",
    "actions.js",
    "main.js",
)
"""In the order in which they are joined: each uses those before it."""


def page(header: dict[str, Any], block: Block, stamp: str) -> str:
    """The whole page; `stamp` says what it was made from."""
    return filled(header, block, stamp, source("page.html"), source("style.css"), program())


def filled(
    header: dict[str, Any], block: Block, stamp: str, document: str, style: str, script: str
) -> str:
    """A document with its data, style and script in their places; its title is the header's."""
    text = json.dumps(header, allow_nan=False, separators=(",", ":"))
    return Template(document).substitute(
        title=html.escape(f"{header['title']} · imocap"),
        stamp=html.escape(stamp, quote=True),
        style=style,
        header=text.replace("<", "\\u003c"),  # no name may end the element
        blob=block.base64(),
        script=script,
    )


def program() -> str:
    """The page's JavaScript, all files in one."""
    return joined(SCRIPTS)


def joined(names: Sequence[str], package: str = _PACKAGE) -> str:
    """Files of JavaScript, one after another."""
    return "\n".join(f"// --- {name}\n{source(name, package)}" for name in names)


def sources() -> str:
    """Everything that the page is made of apart from its data: for its stamp."""
    return source("page.html") + source("style.css") + program()


def source(name: str, package: str = _PACKAGE) -> str:
    """A file of a page's program, from the folder web of a package."""
    return (resources.files(package) / "web" / name).read_text(encoding="utf-8")
