"""Training on the clips that are to be aligned, on all pairs of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from benchmarks.tcc.clips import TccClip
from benchmarks.tcc.encoders import encoder_for, mirrored
from benchmarks.tcc.loss import cycle_back_regression
from benchmarks.tcc.settings import TccSettings

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
