"""How many occurrences of a movement an example finds, alone and with further examples.

    python -m tools.measure_occurrences ../shared/data --seeds 1 2 3

Eight movements of captured performances, each take filmed from a random side, some of them cut off,
through the simulated detector `mediapipe`, and lifted. One take in two or so is an example, filmed
once more from another side; all others are the films. Movements that are alike (ALIKE) do not count
for each other. docs/collect.md has the figures.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int

from benchmarks.actions.captured_videos import PLACEMENTS, SIZE, trial_videos
from benchmarks.screening_casts import detected
from benchmarks.sync_scenes import CAPTURED_FPS, training_clip
from imocap_core.collect.films import ShotTrack
from imocap_core.collect.matching import RATES, FilmTracks, Match, part_of, samples_of, template_of
from imocap_core.collect.movement import by_further_examples, matches_of_all, threshold
from imocap_core.lifter.infer import lift
from imocap_core.lifter.lifter_network import load_lifter, to_common
from imocap_core.params import CollectParams

FILES = {
    "backhand": "tennis_backhand_jarua",
    "forehand": "tennis_forehand_jpcardona",
    "volley": "tennis_forehand_volley_jjmarin",
    "jump": "cmu_jump_s13",
    "forward jump": "cmu_forward_jump_s13",
    "dribble": "cmu_dribble_forward_s06",
    "climb": "cmu_climb_3_steps_s13",
}
MOST_TAKES = 8
WALK, WALKS, WALKED_S = "walk", ("02_01", "03_01", "05_01", "07_04", "12_01"), 2.3
ALIKE = ({"jump", "forward jump"}, {"forehand", "volley"})
CUT_OFF, MOST_CUT, EXAMPLES, EDGE_FRAMES = 0.3, 0.2, 0.6, 3
BOX_PX = (0.0, 0.0, 100.0, 300.0)


@dataclass(frozen=True)
class FilmedTake:
    """A film of a movement, and another film of the whole take that can be the example."""

    movement: str
    film: ShotTrack
    example: ShotTrack | None


def performances(data: Path, rng: np.random.Generator) -> Iterator[tuple[str, np.ndarray, float]]:
    """Movement, joints (T, 14, 3) in metres and frames a second of every take."""
    for movement, name in FILES.items():
        for video in trial_videos(data / "trials" / f"{name}.npz", MOST_TAKES):
            yield movement, video.joints_m[video.frames], video.fps
    for clip in WALKS:
        joints = training_clip(data / "train" / "cmu_train.npz", clip)
        length = min(len(joints), round(WALKED_S * CAPTURED_FPS))
        for _ in range(2):
            first = int(rng.integers(0, len(joints) - length + 1))
            yield WALK, joints[first : first + length], CAPTURED_FPS


def filmed(
    joints_m: Float[np.ndarray, "T 14 3"], fps: float, shot: int, rng: np.random.Generator
) -> ShotTrack:
    """A take from a random side, detected and lifted."""
    view = PLACEMENTS[rng.integers(len(PLACEMENTS))]
    detections = detected(joints_m, view, fps, "mediapipe", rng)
    rays = (detections.xy_px - 0.5 * np.array(SIZE)) / max(SIZE)
    rays = np.where(detections.confidence[..., None] > 0, rays, np.nan)
    lifted = lift(load_lifter(), *to_common(rays, detections.confidence, "coco18"), fps)
    box = np.tile(BOX_PX, (len(joints_m), 1))
    return ShotTrack(
        0, shot, 0, 0, fps, lifted.joints, lifted.sigma_m, lifted.visible, detections.xy_px,
        detections.confidence, box,
    )  # fmt: skip


def takes_of(data: Path, seed: int) -> list[FilmedTake]:
    """All takes of a draw."""
    rng = np.random.default_rng(seed)
    takes = []
    for number, (movement, joints, fps) in enumerate(performances(data, rng)):
        cuts = rng.uniform(0, MOST_CUT, 2) if rng.random() < CUT_OFF else np.zeros(2)
        first, last = (int(cut * len(joints)) for cut in cuts)
        film = filmed(joints[first : len(joints) - last], fps, number, rng)
        example = filmed(joints, fps, number, rng) if rng.random() < EXAMPLES else None
        takes.append(FilmedTake(movement, film, example))
    return takes


def found_and_false(
    takes: list[FilmedTake], movement: str, matches: list[list[Match]], params: CollectParams
) -> tuple[int, int]:
    """Takes with a clear match that show the movement, and that show something else."""
    least = threshold(matches, params)
    shown = [t.movement for t, m in zip(takes, matches, strict=True) if m and m[0].score >= least]
    right = sum(name == movement for name in shown)
    alike = sum(name != movement and {name, movement} in ALIKE for name in shown)
    return right, len(shown) - right - alike


def counts_of_draw(
    takes: list[FilmedTake], params: CollectParams
) -> tuple[int, Int[np.ndarray, "2 2"]]:
    """Occurrences that there are, over all examples; and of what is taken those that are one and
    those that are not: by the example alone, and with further examples."""
    counts, there = np.zeros((2, 2), dtype=int), 0
    samples = [[samples_of(take.film, rate) for rate in RATES] for take in takes]
    for number, take in enumerate(takes):
        if take.example is None:
            continue
        others = [k for k in range(len(takes)) if k != number]
        films = [takes[k] for k in others]
        people = FilmTracks([film.film for film in films], [samples[k] for k in others])
        whole = samples_of(take.example, 1.0)
        last = len(take.example.joints) - EDGE_FRAMES
        inside = (whole.frame >= EDGE_FRAMES) & (whole.frame < last)
        template = template_of(part_of(whole, inside), people.pool())
        alone = matches_of_all(people, template)
        further = by_further_examples(people, alone, params)
        there += sum(film.movement == take.movement for film in films)
        for row, matches in enumerate((alone, further)):
            counts[row] += found_and_false(films, take.movement, matches, params)
    return there, counts


def main() -> None:
    """Print the counts of every draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    for seed in arguments.seeds:
        there, counts = counts_of_draw(takes_of(arguments.data, seed), CollectParams())
        print(
            f"seed {seed}, {there} occurrences: by the example alone {counts[0, 0]} and "
            f"{counts[0, 1]} false; with further examples {counts[1, 0]} and {counts[1, 1]} false"
        )


if __name__ == "__main__":
    main()
