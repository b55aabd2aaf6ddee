"""The network: common points, rays to them, an MLP mixer over a window of frames, its weights.

The common points: detectors' keypoints by their place on the body, not by the detector's name. A
layout's columns map to the points at which they lie; points that it does not have stay empty.

Input features of the network: rays to the points in person-centred camera axes. Rotating the camera
so that its optical axis passes through the person makes the features independent of the person's
position in the picture. The person's size in rays is a feature of its own: it determines the
distance, and so how strong the perspective is.

The network: an MLP mixer over a window of frames, with an output for every frame. Two linear layers
mix the frames of a channel, two mix the channels of a frame, in turn (Tolstikhin et al.,
"MLP-Mixer", NeurIPS 2021): on a CPU nothing but matrix products.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor, nn

from imocap_core.body.layouts import Keypoint, layout_keypoints
from imocap_core.conventions import JOINTS, SMPL_JOINTS, mirror_indices

COMMON: tuple[str, ...] = (
    *("nose", "left_eye", "right_eye", "left_ear", "right_ear"),
    *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    *("left_hip_seen", "right_hip_seen"),
    *("left_knee", "right_knee", "left_ankle", "right_ankle"),
    *("left_big_toe", "right_big_toe", "left_small_toe", "right_small_toe"),
    *("left_heel", "right_heel"),
    *("shoulder_middle", "mid_hip", "head_top", "upper_neck"),
    *("left_hip", "right_hip", "pelvis", "spine2", "neck", "head"),
)
MIRROR = mirror_indices(COMMON)
SHOWN_BY = {"left_hip": "left_hip_seen", "right_hip": "right_hip_seen", "head": "nose"}
LEAST_POINTS = 6  # a layout that has fewer of them does not determine a pose


def columns_of(layout: str) -> tuple[list[int], list[int]]:
    """Columns of a layout and, for each, its row in `COMMON`.

    ValueError when the layout is unknown or has too few of the points (`can_lift`).
    """
    column_of = {
        _point(keypoint): column
        for column, keypoint in reversed(list(enumerate(layout_keypoints(layout))))
    }
    rows = [row for row, point in enumerate(COMMON) if point in column_of]
    if len(rows) < LEAST_POINTS:
        raise ValueError(
            f"layout {layout}: expected at least {LEAST_POINTS} of the lifter's points, got "
            f"{len(rows)}"
        )
    return [column_of[COMMON[row]] for row in rows], rows


def _point(keypoint: Keypoint) -> str:
    """The body point of a keypoint; MediaPipe's definitions of limb ends count as those ends."""
    return keypoint.point.removesuffix("_mediapipe").removesuffix("_blazepose")


def can_lift(layout: str) -> bool:
    """Whether a layout has enough of the common points."""
    points = {_point(keypoint) for keypoint in layout_keypoints(layout)}
    return sum(point in points for point in COMMON) >= LEAST_POINTS


def to_common(
    xy: Float[np.ndarray, "T K 2"], confidence: Float[np.ndarray, "T K"], layout: str
) -> tuple[Float[np.ndarray, "T 33 2"], Float[np.ndarray, "T 33"]]:
    """A detector's keypoints and confidences in the order of the common points.

    Missing points are 0 with confidence 0; confidences are clipped at 1.
    """
    columns, rows = columns_of(layout)
    points = np.zeros((len(xy), len(COMMON), 2))
    trust = np.zeros(points.shape[:2])
    visible = np.isfinite(xy[:, columns]).all(-1) & (confidence[:, columns] > 0)
    points[:, rows] = np.where(visible[..., None], xy[:, columns], 0.0)
    trust[:, rows] = np.where(visible, np.minimum(confidence[:, columns], 1.0), 0.0)
    return points, trust


def joints_seen(confidence: Float[np.ndarray, "T 33"], layout: str) -> Float[np.ndarray, "T 24"]:
    """How well each of SMPL's joints is seen: the confidence (`to_common`) of the point at it, or
    of the one that shows it; 1 where the layout has neither."""
    rows = set(columns_of(layout)[1])
    shown = np.ones((len(confidence), len(SMPL_JOINTS)))
    for joint, name in enumerate(SMPL_JOINTS):
        for point in (name, SHOWN_BY.get(name)):
            if point in COMMON and COMMON.index(point) in rows:
                shown[:, joint] = confidence[:, COMMON.index(point)]
                break
    return shown


FEATURES = 3 * len(COMMON) + 4
LEAST_DEPTH = 0.1  # of a ray's direction: points further than 84 degrees to the side are not used
MOST = 6.0  # coordinates are clipped here, in units of the person's size


@dataclass(frozen=True)
class LifterInput:
    """Features of B windows of L frames, and the camera rotation that centres the person."""

    features: Float[Tensor, "B L F"]
    R_turned_from_cam: Float[Tensor, "B 3 3"]


def person_centred_features(
    rays: Float[Tensor, "B L K 2"], confidence: Float[Tensor, "B L K"]
) -> LifterInput:
    """Features of windows of rays.

    Args:
        rays: ``(x - c) / f`` of the points `COMMON`. confidence: 0 where missing.
    """
    R = _centring_rotation(rays, confidence > 0)
    directions = torch.cat([rays, torch.ones_like(rays[..., :1])], -1)
    turned = torch.einsum("bij,blkj->blki", R, directions)
    visible = (confidence > 0) & (turned[..., 2] > LEAST_DEPTH)
    xy = turned[..., :2] / turned[..., 2:].clamp_min(LEAST_DEPTH)
    hidden = ~visible[..., None].expand_as(xy)
    middle = xy.masked_fill(hidden, torch.nan).nanmedian(-2).values.nan_to_num(0.0)
    local = xy - middle[:, :, None]
    radius = local.norm(dim=-1).masked_fill(~visible, torch.nan).flatten(1).nanmedian(1).values
    size = radius.nan_to_num(0.1).clamp_min(1e-4)[:, None, None]
    present = visible.any(-1, keepdim=True).to(rays)
    trust = torch.where(visible, confidence, 0.0)
    local = torch.where(visible[..., None], (local / size[..., None]).clamp(-MOST, MOST), 0.0)
    path = (middle / size).clamp(-MOST, MOST) * present
    nearness = (size / 0.1).log() * present
    parts = [local.flatten(2), trust, path, nearness, present]
    return LifterInput(torch.cat(parts, -1), R)


def _centring_rotation(
    rays: Float[Tensor, "B L K 2"], visible: Bool[Tensor, "B L K"]
) -> Float[Tensor, "B 3 3"]:
    """R_turned_from_cam: pan, then tilt, without roll, towards the median ray."""
    hidden = ~visible[..., None].expand_as(rays)
    x, y = rays.masked_fill(hidden, torch.nan).flatten(1, 2).nanmedian(1).values.nan_to_num(0.0).T
    side = (1 + x * x).sqrt()
    pan_c, pan_s = 1 / side, x / side
    whole = (side * side + y * y).sqrt()
    tilt_c, tilt_s = side / whole, y / whole
    none = torch.zeros_like(x)
    rows = [
        torch.stack([pan_c, none, -pan_s], -1),
        torch.stack([-tilt_s * pan_s, tilt_c, -tilt_s * pan_c], -1),
        torch.stack([tilt_c * pan_s, tilt_s, tilt_c * pan_c], -1),
    ]
    return torch.stack(rows, -2)


WINDOW = 27  # frames
RATE_HZ = 15.0  # of the frames of a window, about
WIDTH = 256
BLOCKS = 6
HYPOTHESES = 2  # in addition to the mean


@dataclass(frozen=True)
class LifterOutput:
    """The network's output for B windows of L frames, in person-centred camera axes.

    Attributes:
        joints: metres, relative to the pelvis.
        log_variance: logarithm of the expected squared error of each joint in space, m^2.
        alternatives: further hypotheses of the joints.
        logits: of the hypotheses' probabilities.
    """

    joints: Float[Tensor, "B L 24 3"]
    log_variance: Float[Tensor, "B L 24"]
    alternatives: Float[Tensor, "B L H 24 3"]
    logits: Float[Tensor, "B H"]


class _Block(nn.Module):
    def __init__(self, width: int, window: int) -> None:
        super().__init__()
        self.frames_norm = nn.LayerNorm(width)
        self.frames_in = nn.Linear(window, 2 * window)
        self.frames_out = nn.Linear(2 * window, window)
        self.channels_norm = nn.LayerNorm(width)
        self.channels_in = nn.Linear(width, 2 * width)
        self.channels_out = nn.Linear(2 * width, width)

    def forward(self, x: Float[Tensor, "B L D"]) -> Float[Tensor, "B L D"]:
        y = self.frames_norm(x).transpose(1, 2)
        y = self.frames_out(nn.functional.gelu(self.frames_in(y)))
        x = x + y.transpose(1, 2)
        y = self.channels_norm(x)
        return x + self.channels_out(nn.functional.gelu(self.channels_in(y)))


class Lifter(nn.Module):
    """Features of windows of frames (`rays.person_centred_features`) to a `LifterOutput`."""

    def __init__(self, width: int = WIDTH, blocks: int = BLOCKS, window: int = WINDOW) -> None:
        super().__init__()
        self.first = nn.Linear(FEATURES, width)
        self.blocks = nn.ModuleList([_Block(width, window) for _ in range(blocks)])
        self.norm = nn.LayerNorm(width)
        self.joints = nn.Linear(width, JOINTS * 3)
        self.log_variance = nn.Linear(width, JOINTS)
        self.alternatives = nn.Linear(width, HYPOTHESES * JOINTS * 3)
        self.logits = nn.Linear(width, HYPOTHESES)

    def forward(self, features: Float[Tensor, "B L F"]) -> LifterOutput:
        x = self.first(features)
        for block in self.blocks:
            x = block(x)
        x = self.norm(x)
        joints = self.joints(x).float().unflatten(-1, (JOINTS, 3))
        others = self.alternatives(x).float().unflatten(-1, (HYPOTHESES, JOINTS, 3))
        return LifterOutput(
            joints - joints[:, :, :1],
            self.log_variance(x).float(),
            others - others[..., :1, :],
            self.logits(x.mean(1)).float(),
        )


NAME = "lifter.safetensors"
METADATA = {"licence": "Apache-2.0", "record": "docs/lifter.md"}


@lru_cache(maxsize=2)
def load_lifter(device: torch.device | str = "cpu") -> Lifter:
    """The packaged network, ready for inference (float32, no gradients)."""
    source = resources.files("imocap_core.lifter") / "data" / NAME
    return read_weights(source.read_bytes(), NAME).to(device)


def read_weights(content: bytes, name: str) -> Lifter:
    """The network of a weights file. ValueError names the file when it is damaged or unfit."""
    network = Lifter()
    try:
        network.load_state_dict(load(content))
    except (SafetensorError, RuntimeError) as error:  # torch: a missing name or another shape
        raise ValueError(f"{name}: expected the lifter's weights, got {error}") from None
    return network.eval().requires_grad_(False)


def write_weights(path: Path, network: Lifter) -> None:
    """Write a network's weights as float16."""
    halves = {
        name: weight.detach().cpu().to(torch.float16).contiguous()
        for name, weight in network.state_dict().items()
    }
    path.write_bytes(save(halves, METADATA))
