"""Train the lifter: ``python tools/train_lifter.py DATA/train/cmu_train.npz --work FOLDER``.

Fixed seeds; one process and one thread on a processor. Motions are the training clips retargeted
to the free body (tools/lifter/motions.py) with people's legs, made motions
(tools/lifter/made_motions.py), their recombinations and poses of the prior, with random cameras and
a simulated detector. With `--device cuda`, batches are larger and made by worker processes, and
`--minutes 8` trains it all. Every eighth clip is held out for validation. The weights go to
imocap_core/lifter/data, the curve beside the checkpoint; no motion is stored with either.
"""

import argparse
import json
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from lifter.filming import detect, film_windows
from lifter.made_motions import performances
from lifter.motions import FittedClip, fit_all, with_straight_legs
from lifter.performances import Motions, TrainingBodies, motions_of, windows
from torch import Tensor
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from imocap_core.lifter.lifter_network import (
    Lifter,
    LifterOutput,
    load_lifter,
    person_centred_features,
    write_weights,
)

TARGET = Path(__file__).parents[1] / "imocap_core" / "lifter" / "data" / "lifter.safetensors"
SEED = 7
HELD_OUT_EVERY = 8
BATCH, CARD_BATCH = 48, 384  # windows
MADE, MADE_FRAMES = 2500, 82  # performances of 1/30 s frames: the longest window
MADE_HELD_OUT = 40
VALIDATION_BATCHES = 6
PEAK_RATE, WEIGHT_DECAY = 1.5e-3, 0.02
AVERAGING = 0.998  # exponential moving average of the weights
CHECK_EVERY = 500


def batch_of(
    motions: Motions, bodies: TrainingBodies, count: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Features (B, L, F) and true joints (B, L, 24, 3), relative to the pelvis, in person-centred
    camera axes."""
    R_local, trans = windows(motions, count, rng)
    points, joints = bodies.perform(R_local, trans, rng)
    rays, height, joints_cam = film_windows(points, joints, rng)
    centred = person_centred_features(*detect(rays, height, rng))
    relative = joints_cam - joints_cam[:, :, :1]
    return centred.features, torch.einsum("bij,blkj->blki", centred.R_turned_from_cam, relative)


@dataclass
class Batches(IterableDataset):  # type: ignore[type-arg]
    """Endless batches of windows; every worker has a generator of its own."""

    motions: Motions
    bodies: TrainingBodies
    size: int
    seed: list[int]

    def __iter__(self) -> Iterator[tuple[Tensor, Tensor]]:
        worker = get_worker_info()
        torch.set_num_threads(1)
        rng = np.random.default_rng([*self.seed, worker.id if worker else 0])
        while True:
            yield batch_of(self.motions, self.bodies, self.size, rng)


def made_motions(cache: Path) -> list[FittedClip]:
    """Performances one after another, kinds mixed; `cache` (npz) is read when it exists."""
    if not cache.exists():
        kinds = performances(MADE, SEED, MADE_FRAMES).values()
        np.savez(cache, theta=np.concatenate([k.theta for k in kinds]),
                 trans=np.concatenate([k.trans for k in kinds]))  # fmt: skip
    with np.load(cache) as stored:
        both = list(zip(stored["theta"], stored["trans"], strict=True))
    return [both[row] for row in np.random.default_rng(SEED).permutation(len(both))]


def loss_of(output: LifterOutput, true: Tensor, visible: Tensor) -> Tensor:
    """Mean error of joints and of their steps, likelihood of the variance, best alternative."""
    weight = (0.1 + 0.9 * visible) / (0.1 + 0.9 * visible).mean()
    distance = (output.joints - true).norm(dim=-1)
    steps = (output.joints.diff(dim=1) - true.diff(dim=1)).norm(dim=-1).mean()
    squared = distance.detach().square() + 1e-5
    likelihood = (squared / output.log_variance.exp() + output.log_variance).mean()
    others = (output.alternatives - true[:, :, None]).norm(dim=-1).mean((1, 3))
    best = others.min(1)
    alternative = 0.95 * best.values.mean() + 0.05 * others.mean()
    which = torch.nn.functional.cross_entropy(output.logits, best.indices)
    joint_loss = (weight * distance).mean() + 0.5 * steps
    return joint_loss + 0.5 * alternative + 0.005 * (likelihood + which)


@torch.no_grad()
def errors_mm(network: Lifter, batches: list[tuple[Tensor, Tensor]]) -> dict[str, float]:
    """Mean joint errors of held-out windows: of the mean output in frames with visible points, and
    of the best among the mean output and the alternatives of each window."""
    network.eval()
    mean, best = [], []
    for features, true in batches:
        output = network(features)
        visible = features[..., -1] > 0
        frame_errors = (output.joints - true).norm(dim=-1).mean(-1)[visible]
        hypotheses = torch.cat([output.joints[:, :, None], output.alternatives], 2)
        window = (hypotheses - true[:, :, None]).norm(dim=-1).mean((1, 3)).min(1).values
        mean.append(frame_errors.mean())
        best.append(window.mean())
    network.train()
    errors = {"mean": torch.stack(mean).mean(), "best": torch.stack(best).mean()}
    return {k: round(1000 * float(v), 2) for k, v in errors.items()}


def main() -> None:
    """Read, train, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    parser.add_argument(
        "--work", type=Path, required=True, help="fitted motions, checkpoint, curve"
    )
    parser.add_argument("--steps", type=int, default=15000)
    parser.add_argument("--minutes", type=float, default=1e9, help="the rate falls to 0 by then")
    parser.add_argument("--device", default="cpu")
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on from the checkpoint, or from the shipped weights where there is none",
    )
    parser.add_argument("--rate", type=float, default=PEAK_RATE, help="the highest rate")
    parser.add_argument(
        "--float32",
        action="store_true",
        help="not bfloat16, which takes eight times as long where the processor has to emulate it",
    )
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(SEED)
    card = arguments.device != "cpu"
    arguments.work.mkdir(parents=True, exist_ok=True)
    fitted = fit_all(arguments.train, arguments.work / "motions.npz")
    clips = {k: with_straight_legs(clip) for k, clip in sorted(fitted.items())}
    held_out = list(clips)[::HELD_OUT_EVERY]
    made = made_motions(arguments.work / "made.npz")
    bodies = TrainingBodies()
    captured = [clip for k, clip in clips.items() if k not in held_out]
    motions = motions_of(captured, made[MADE_HELD_OUT:], np.random.default_rng(SEED))
    validation = motions_of(
        [clips[k] for k in held_out], made[:MADE_HELD_OUT], np.random.default_rng(1)
    )
    validation_rng = np.random.default_rng(2)
    batches = [batch_of(validation, bodies, 64, validation_rng) for _ in range(VALIDATION_BATCHES)]
    batches = [(f.to(arguments.device), true.to(arguments.device)) for f, true in batches]
    seed = [SEED, int(arguments.resume)]
    loader = DataLoader(
        Batches(motions, bodies, CARD_BATCH if card else BATCH, seed), batch_size=None,
        num_workers=os.cpu_count() or 1 if card else 0, pin_memory=card,
    )  # fmt: skip
    network, averaged = Lifter().to(arguments.device), Lifter().to(arguments.device)
    if arguments.resume:
        checkpoint = arguments.work / "checkpoint.pt"
        is_known = torch.load(checkpoint) if checkpoint.exists() else load_lifter().state_dict()
        network.load_state_dict(is_known)
    averaged.load_state_dict(network.state_dict())
    print(
        f"{sum(p.numel() for p in network.parameters())} weights, held out: {', '.join(held_out)}",
        flush=True,
    )
    print({"step": 0, **errors_mm(averaged, batches)}, flush=True)
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=WEIGHT_DECAY)
    began, curve = time.monotonic(), []
    for step, (features, true) in enumerate(loader, 1):
        spent_s = time.monotonic() - began
        done = max(step / arguments.steps, spent_s / 60 / arguments.minutes)
        for group in optimiser.param_groups:
            group["lr"] = arguments.rate * min(1.0, step / 300) * max(0.0, 1.0 - done)
        features, true = features.to(arguments.device), true.to(arguments.device)
        with torch.autocast(arguments.device, torch.bfloat16, enabled=not arguments.float32):
            output = network(features)
        loss = loss_of(output, true, features[..., -1:])
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        decay = min(AVERAGING, step / (step + 100))
        with torch.no_grad():
            for a, b in zip(averaged.parameters(), network.parameters(), strict=True):
                a.lerp_(b, 1 - decay)
        if step % CHECK_EVERY == 0 or done >= 1.0:
            errors = errors_mm(averaged, batches)
            curve.append(
                {"step": step, "seconds": round(spent_s), "loss": round(loss.item(), 4), **errors}
            )
            print(curve[-1], flush=True)
            torch.save(averaged.state_dict(), arguments.work / "checkpoint.pt")
            (arguments.work / f"curve{'_resumed' * arguments.resume}.json").write_text(
                json.dumps(curve, indent=1)
            )
        if done >= 1.0:
            break
    TARGET.parent.mkdir(parents=True, exist_ok=True)
    write_weights(TARGET, averaged)


if __name__ == "__main__":
    main()
