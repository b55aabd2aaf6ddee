"""Train the lifter: ``python tools/train_lifter.py DATA/train/cmu_train.npz``.

One process, one thread, fixed seeds. Motions are the training clips as the free body performs them
(tools/lifter/motions.py), their recombinations and poses of the prior, seen by random cameras and
found by a detector that errs. Every eighth clip is held out and watched. The weights go to
imocap_core/lifter/data, the curve beside the checkpoint; no motion is stored with either.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch
from lifter.filming import detect, film
from lifter.motions import fit_all
from lifter.performances import Motions, Performers, motions_of, windows
from torch import Tensor

from imocap_core.lifter.network import Lifter, LifterOutput, count_weights
from imocap_core.lifter.rays import person_centred_features
from imocap_core.lifter.weights import write_weights

TARGET = Path(__file__).parents[1] / "imocap_core" / "lifter" / "data" / "lifter.safetensors"
SEED = 7
HELD_OUT_EVERY = 8
BATCH = 48  # windows
VALIDATION_BATCHES = 6
PEAK_RATE, WEIGHT_DECAY = 1.5e-3, 0.02
AVERAGING = 0.998  # exponential moving average of the weights
CHECK_EVERY = 500


def batch_of(
    motions: Motions, performers: Performers, count: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor]:
    """Features (B, L, F) and true joints (B, L, 24, 3) relative to the pelvis, turned camera."""
    R_local, trans = windows(motions, count, rng)
    points, joints = performers.perform(R_local, trans, rng)
    rays, height, joints_cam = film(points, joints, rng)
    seen = person_centred_features(*detect(rays, height, rng))
    relative = joints_cam - joints_cam[:, :, :1]
    return seen.features, torch.einsum("bij,blkj->blki", seen.R_turned_from_cam, relative)


def loss_of(answer: LifterOutput, true: Tensor, there: Tensor) -> Tensor:
    """Mean distance of joints and of their steps; the variance and the alternatives beside it."""
    weight = (0.1 + 0.9 * there) / (0.1 + 0.9 * there).mean()
    distance = (answer.joints - true).norm(dim=-1)
    steps = (answer.joints.diff(dim=1) - true.diff(dim=1)).norm(dim=-1).mean()
    squared = distance.detach().square() + 1e-5
    likely = (squared / answer.log_variance.exp() + answer.log_variance).mean()
    others = (answer.alternatives - true[:, :, None]).norm(dim=-1).mean((1, 3))
    best = others.min(1)
    taken = 0.95 * best.values.mean() + 0.05 * others.mean()
    which = torch.nn.functional.cross_entropy(answer.logits, best.indices)
    return (weight * distance).mean() + 0.5 * steps + 0.5 * taken + 0.005 * (likely + which)


@torch.no_grad()
def errors_mm(network: Lifter, batches: list[tuple[Tensor, Tensor]]) -> dict[str, float]:
    """Mean joint errors of held-out windows: of the answer where somebody is seen, and of whole
    windows of the best of it and its alternatives."""
    network.eval()
    mean, best = [], []
    for features, true in batches:
        answer = network(features)
        there = features[..., -1] > 0
        own = (answer.joints - true).norm(dim=-1).mean(-1)[there]
        everyone = torch.cat([answer.joints[:, :, None], answer.alternatives], 2)
        window = (everyone - true[:, :, None]).norm(dim=-1).mean((1, 3)).min(1).values
        mean.append(own.mean())
        best.append(window.mean())
    network.train()
    found = {"mean": torch.stack(mean).mean(), "best": torch.stack(best).mean()}
    return {k: round(1000 * float(v), 2) for k, v in found.items()}


def main() -> None:
    """Read, train, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("train", type=Path, help="npz with clip_<id> (T, 27, 3) at 30 frames/s")
    parser.add_argument(
        "--work", type=Path, required=True, help="fitted motions, checkpoint, curve"
    )
    parser.add_argument("--steps", type=int, default=15000)
    parser.add_argument("--minutes", type=float, default=1e9, help="the rate falls to 0 by then")
    parser.add_argument("--resume", action="store_true", help="go on from the checkpoint")
    parser.add_argument("--rate", type=float, default=PEAK_RATE, help="the highest rate")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    torch.manual_seed(SEED)
    rng = np.random.default_rng([SEED, 1] if arguments.resume else SEED)
    arguments.work.mkdir(parents=True, exist_ok=True)
    clips = fit_all(arguments.train, arguments.work / "motions.npz")
    held_out = sorted(clips)[::HELD_OUT_EVERY]
    motions = motions_of([clips[k] for k in sorted(clips) if k not in held_out], rng)
    performers = Performers()
    watched = motions_of([clips[k] for k in held_out], np.random.default_rng(1))
    seeing = np.random.default_rng(2)
    batches = [batch_of(watched, performers, 64, seeing) for _ in range(VALIDATION_BATCHES)]
    network, averaged = Lifter(), Lifter()
    if arguments.resume:
        network.load_state_dict(torch.load(arguments.work / "checkpoint.pt"))
    averaged.load_state_dict(network.state_dict())
    print(f"{count_weights(network)} weights, held out: {', '.join(held_out)}", flush=True)
    print({"step": 0, **errors_mm(averaged, batches)}, flush=True)
    optimiser = torch.optim.AdamW(network.parameters(), weight_decay=WEIGHT_DECAY)
    began, curve, step, done = time.monotonic(), [], 0, 0.0
    while done < 1.0:
        spent_s = time.monotonic() - began
        done = max(step / arguments.steps, spent_s / 60 / arguments.minutes)
        for group in optimiser.param_groups:
            group["lr"] = arguments.rate * min(1.0, (step + 1) / 300) * max(0.0, 1.0 - done)
        features, true = batch_of(motions, performers, BATCH, rng)
        with torch.autocast("cpu", torch.bfloat16):
            answer = network(features)
        loss = loss_of(answer, true, features[..., -1:])
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        step += 1
        keep = min(AVERAGING, step / (step + 100))
        with torch.no_grad():
            for a, b in zip(averaged.parameters(), network.parameters(), strict=True):
                a.lerp_(b, 1 - keep)
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
    TARGET.parent.mkdir(parents=True, exist_ok=True)
    write_weights(TARGET, averaged)


if __name__ == "__main__":
    main()
