"""Temporal Cycle-Consistency Learning (Dwibedi et al., CVPR 2019), trained on the clips to align.

A network embeds every frame; cycle consistency between the clips is all that it learns from. The
clips are then aligned by DTW on distances between embeddings. See docs/measurements.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from torch import Tensor, nn

from imocap_core.sync.warp.dtw import dtw, positions_of_rows
from imocap_core.sync.warp.template import mass_within

# Every setting of the baseline in one value, and the value in use.


@dataclass(frozen=True)
class TccSettings:
    """Temperature and variance weight are those of the paper's released code; the schedule is short
    because each training sees one action only (docs/measurements.md)."""

    embedding: int  # channels D of the embedding
    taps: int  # frames of the window that is embedded, centred on its frame; odd
    spacing_s: float  # time between two frames of the window
    steps: int  # of Adam
    sampled: int  # frames of each video in one step
    noise: float  # standard deviation added to the inputs in training
    mirrored: float = 0.5  # probability that a clip is mirrored in a step of training
    learning_rate: float = 1e-3
    weight_decay: float = 1e-5
    temperature: float = 0.1  # similarity = -squared distance / (D * temperature)
    variance_weight: float = 0.001  # lambda of the cycle-back regression
    unmatched_level: float = np.inf  # see `align`; inf: every frame is matched
    confidence_reach_s: float = 0.1  # confidence = soft match within this much of the position


POSES = TccSettings(embedding=64, taps=9, spacing_s=0.1, steps=300, sampled=64, noise=0.05)


# Inputs of the encoder: 2D poses, normalised in place and size.

TccClip = Float32[np.ndarray, "T K 3"]  # a pose for each frame


def pose_clip(
    xy_px: Float[np.ndarray, "T K 2"], confidence: Float[np.ndarray, "T K"], root: Sequence[int]
) -> Float32[np.ndarray, "T K 3"]:
    """Keypoints relative to the performer's root, in units of the performer's size: x, y and
    confidence.

    `confidence` in [0, 1]; `root`: the columns whose mean is the root (the hips). The size is the
    median over the clip, so that crouching stays visible. A missing joint is zero with confidence
    zero. ValueError when the root is missing in every frame.
    """
    if xy_px.shape != (*confidence.shape, 2) or not len(root):
        raise ValueError(
            f"expected xy_px (T, K, 2), confidence (T, K) and a root column, got {xy_px.shape}, "
            f"{confidence.shape}, {list(root)}"
        )
    weight = np.where(np.isfinite(xy_px).all(axis=-1), np.nan_to_num(confidence), 0.0)
    visible = weight > 0
    centre = np.where(visible[:, root, None], xy_px[:, root], np.nan)
    rooted = visible[:, root].any(axis=1)
    if not rooted.any():
        raise ValueError(
            "the root is missing in every frame: a clip needs the hips in one frame at least"
        )
    mean = np.full((len(xy_px), 2), np.nan)
    mean[rooted] = np.nanmean(centre[rooted], axis=1)
    about = np.nan_to_num(xy_px) - _interpolated(mean)[:, None]
    reach = np.sqrt((weight[..., None] * about**2).sum((1, 2)) / np.maximum(weight.sum(1), 1e-9))
    size = max(float(np.median(reach[rooted])), 1e-9)
    items = np.concatenate([about / size * visible[..., None], weight[..., None]], axis=-1)
    return np.asarray(items, np.float32)


def _interpolated(path: np.ndarray) -> np.ndarray:
    """Missing rows (NaN) of (T, 2) interpolated, the ends repeated."""
    present = np.isfinite(path).all(axis=1)
    frames = np.arange(len(path))
    return np.column_stack(
        [np.interp(frames, frames[present], column[present]) for column in path.T]
    )


# Embeddings of a moment: a few neighbouring frames in, one vector out.
#
# The input is a window, not the whole clip: a network that sees the ends of the clip could count
# frames from there, which satisfies every cycle and is meaningless.

_HIDDEN = 128


class PoseEncoder(nn.Module):
    """Windows of 2D poses to embeddings by 1D convolutions over time; window length W odd."""

    def __init__(self, points: int, taps: int, embedding: int) -> None:
        super().__init__()
        layers: list[nn.Module] = [nn.Conv1d(3 * points, _HIDDEN, 1)]
        for _ in range(taps // 2):
            layers += [nn.ReLU(), nn.Conv1d(_HIDDEN, _HIDDEN, 3)]
        self.over_time = nn.Sequential(*layers, nn.ReLU(), nn.Conv1d(_HIDDEN, embedding, 1))

    def forward(self, windows: Float[Tensor, "N W K 3"]) -> Float[Tensor, "N D"]:
        """One embedding for each window."""
        out: Tensor = self.over_time(windows.flatten(2).transpose(1, 2))
        return out[..., 0]


def encoder_for(item: torch.Size, taps: int, embedding: int) -> nn.Module:
    """The encoder for the items of a clip, poses (K, 3). ValueError for other shapes."""
    if len(item) != 2 or item[1] != 3:
        raise ValueError(f"a frame: expected a pose (K, 3), got {tuple(item)}")
    return PoseEncoder(item[0], taps, embedding)


def mirrored(windows: Float[Tensor, "N W K 3"]) -> Float[Tensor, "N W K 3"]:
    """Windows of poses with the image's left and right swapped.

    The names of the joints stay: but for perspective, this is the pose as seen from the opposite
    side.
    """
    return windows * windows.new_tensor([-1.0, 1.0, 1.0])


# The cycle-back regression loss with variance (Dwibedi et al. 2019, section 3.2, "cycle-back
# regression").
#
# A frame u_i of one clip looks for its soft nearest neighbour in another clip,
#     alpha_j = softmax_j(-|u_i - v_j|^2 / (D tau)),    v~ = sum_j alpha_j v_j,
# which looks back into the first clip,
#     beta_k = softmax_k(-|v~ - u_k|^2 / (D tau)),
# and should return to the moment that it left from: with the times t of the first clip's frames,
#     mu_i = sum_k beta_k t_k,    sigma_i^2 = sum_k beta_k (t_k - mu_i)^2,
#     loss_i = (t_i - mu_i)^2 / sigma_i^2 + lambda log sigma_i.

LEAST_VARIANCE = 1e-6
"""Of times in [0, 1]: a standard deviation of a thousandth of the clip. It bounds the loss of a
certain match."""


def squared_distances(
    u: Float[Tensor, "... N D"], v: Float[Tensor, "... M D"]
) -> Float[Tensor, "... N M"]:
    """|u_i - v_j|^2 of embeddings."""
    cross = u @ v.transpose(-1, -2)
    squares = (u * u).sum(-1)[..., :, None] + (v * v).sum(-1)[..., None, :] - 2.0 * cross
    return squares.clamp(min=0.0)


def soft_matches(
    u: Float[Tensor, "... N D"], v: Float[Tensor, "... M D"], temperature: float
) -> Float[Tensor, "... N M"]:
    """alpha: the soft nearest neighbours in v of each frame of u; rows sum to 1."""
    return (-squared_distances(u, v) / (u.shape[-1] * temperature)).softmax(dim=-1)


def cycle_back_regression(
    u: Float[Tensor, "P N D"],
    v: Float[Tensor, "P M D"],
    times: Float[Tensor, "P N"],
    *,
    temperature: float,
    variance_weight: float,
) -> Float[Tensor, ""]:
    """Mean loss over pairs and frames.

    `u` and `v`: embeddings of P pairs of clips, sampled in order of time; `times`: those of u's
    frames, in [0, 1] of their clip.
    """
    neighbour = soft_matches(u, v, temperature) @ v
    back = soft_matches(neighbour, u, temperature)
    mean = (back * times[:, None, :]).sum(-1)
    variance = (back * (times[:, None, :] - mean[..., None]) ** 2).sum(-1)
    variance = variance.clamp(min=LEAST_VARIANCE)
    return ((times - mean) ** 2 / variance + 0.5 * variance_weight * variance.log()).mean()


# Training on the clips that are to be aligned, on all pairs of them at once.

_CHUNK = 128  # windows embedded at a time


@dataclass(frozen=True)
class TccTraining:
    """The result of a training: an embedding of every frame of every clip."""

    embeddings: list[Float[np.ndarray, "T D"]]  # per video
    losses: list[float]  # one a step


def train(
    clips: Sequence[TccClip],
    fps: Sequence[float],
    settings: TccSettings,
    *,
    seed: int,
    device: str = "cpu",
) -> TccTraining:
    """Learn an embedding by cycle-back regression between all ordered pairs of clips.

    `clips`: per video poses (T, K, 3) or pictures (T, channels, S, S); `fps` per video. The same
    seed gives the same result on one machine. ValueError for fewer than two clips, or shapes that
    do not fit together.
    """
    _check(clips, fps, settings)
    data = [torch.as_tensor(clip, device=device) for clip in clips]
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        encoder = encoder_for(data[0].shape[1:], settings.taps, settings.embedding).to(device)
    rng = np.random.default_rng(seed)
    generator = torch.Generator(device).manual_seed(seed)
    adam = torch.optim.Adam(
        encoder.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
    )
    offsets = [window_offsets(f, settings, device) for f in fps]
    sampled = min(settings.sampled, *(len(clip) for clip in clips))
    first, second = np.nonzero(~np.eye(len(clips), dtype=bool))
    losses = []
    for _ in range(settings.steps):
        frames = [_sample(len(clip), sampled, rng, device) for clip in clips]
        originals = [windows_at(x, i, o) for x, i, o in zip(data, frames, offsets, strict=True)]
        flips = rng.random(len(clips)) < settings.mirrored
        windows = torch.cat(
            [mirrored(w) if f else w for w, f in zip(originals, flips, strict=True)]
        )
        noise = torch.randn(windows.shape, generator=generator, device=device)
        z = encoder(windows + settings.noise * noise).reshape(len(clips), sampled, -1)
        times = torch.stack([i / max(len(x) - 1, 1) for x, i in zip(data, frames, strict=True)])
        loss = cycle_back_regression(
            z[first],
            z[second],
            times[first],
            temperature=settings.temperature,
            variance_weight=settings.variance_weight,
        )
        adam.zero_grad()
        loss.backward()
        adam.step()
        losses.append(float(loss.detach()))
    return TccTraining([embed(encoder, x, o) for x, o in zip(data, offsets, strict=True)], losses)


@torch.no_grad()
def embed(
    encoder: nn.Module, clip: Float[Tensor, "T ..."], offsets: Int[Tensor, " W"]
) -> Float[np.ndarray, "T D"]:
    """The embedding of every frame of a clip."""
    frames = torch.arange(len(clip), device=clip.device)
    parts = [encoder(windows_at(clip, part, offsets)) for part in frames.split(_CHUNK)]
    return np.asarray(torch.cat(parts).cpu().numpy(), np.float64)


def window_offsets(fps: float, settings: TccSettings, device: str = "cpu") -> Int[Tensor, " W"]:
    """The frames of a window, counted from its middle."""
    steps = np.arange(settings.taps) - settings.taps // 2
    frames = np.rint(steps * settings.spacing_s * fps).astype(np.int64)
    return torch.as_tensor(frames, device=device)


def windows_at(
    clip: Float[Tensor, "T ..."], frames: Int[Tensor, " N"], offsets: Int[Tensor, " W"]
) -> Float[Tensor, "N W ..."]:
    """Windows around some frames of a clip; its first and last frame are repeated."""
    return clip[(frames[:, None] + offsets).clamp(0, len(clip) - 1)]


def _sample(length: int, count: int, rng: np.random.Generator, device: str) -> Tensor:
    """Frames of a clip drawn without repetition, in order."""
    frames = np.sort(rng.choice(length, size=count, replace=False))
    return torch.as_tensor(frames, device=device)


def _check(clips: Sequence[TccClip], fps: Sequence[float], settings: TccSettings) -> None:
    faults = []
    if len(clips) < 2:
        faults.append(f"clips: cycles need two or more, got {len(clips)}")
    if len(fps) != len(clips):
        faults.append(f"fps: expected one per clip ({len(clips)}), got {len(fps)}")
    if settings.taps % 2 == 0:
        faults.append(f"taps: expected an odd number, got {settings.taps}")
    for v, clip in enumerate(clips):
        if len(clip) < 2 or clip.shape[1:] != clips[0].shape[1:]:
            faults.append(
                f"clip {v}: expected (T >= 2, ...) with frames like clip 0's, got {clip.shape}"
            )
    if faults:
        raise ValueError("; ".join(faults))


# From embeddings to positions in the reference, by the DTW of the pipeline's synchronisation.


@dataclass(frozen=True)
class TccAlignment:
    """The position of every frame in the reference; the first three as in `sync.SyncResult`."""

    reference: int
    reference_frame: list[Float[np.ndarray, " T"]]  # per video, fractional; NaN unmatched
    confidence: list[Float[np.ndarray, " T"]]  # per video, in [0, 1]
    losses: list[float]  # of the training, one a step; empty without training


def align_by_tcc(
    clips: Sequence[TccClip],
    fps: Sequence[float],
    settings: TccSettings,
    *,
    reference: int,
    seed: int,
    device: str = "cpu",
) -> TccAlignment:
    """Train on the clips (`pose_clip` or `frame_clip`, one a video), then align them to one."""
    trained = train(clips, fps, settings, seed=seed, device=device)
    return align(trained.embeddings, fps, settings, reference=reference, losses=trained.losses)


def align(
    embeddings: Sequence[Float[np.ndarray, "T D"]],
    fps: Sequence[float],
    settings: TccSettings,
    *,
    reference: int,
    losses: Sequence[float] = (),
) -> TccAlignment:
    """DTW of each video's embeddings with the reference's.

    With a finite `unmatched_level` the ends are open: a frame before the path's start or after its
    end costs this share of the way from the usual distance of matching frames to that of any two
    frames. ValueError for an unknown reference.
    """
    if not 0 <= reference < len(embeddings):
        raise ValueError(f"reference: expected 0 to {len(embeddings) - 1}, got {reference}")
    target = torch.as_tensor(embeddings[reference])
    reach = settings.confidence_reach_s * fps[reference]
    frames, confidence = [], []
    for v, embedding in enumerate(embeddings):
        z = torch.as_tensor(embedding)
        cost = squared_distances(z, target).sqrt().numpy()
        if v == reference:
            position = np.arange(float(len(embedding)))
        else:
            path, _ = dtw(cost, skip=_skip_of(cost, settings.unmatched_level))
            position = positions_of_rows(path, len(embedding))
        soft = soft_matches(z, target, settings.temperature).numpy()
        certain = mass_within(soft, np.nan_to_num(position), reach)
        frames.append(position)
        confidence.append(np.where(np.isfinite(position), np.clip(certain, 0.0, 1.0), 0.0))
    confidence[reference] = np.ones(len(embeddings[reference]))
    return TccAlignment(reference, frames, confidence, list(losses))


def _skip_of(cost: np.ndarray, share: float) -> float:
    if not np.isfinite(share):
        return np.inf
    near, usual = float(np.median(cost.min(axis=1))), float(np.median(cost))
    return near + share * (usual - near)
