"""Try settings of the synchronisation on scenes made of the training clips (or, to measure only, on
the benchmark's): python tools/try_sync.py released performed --set method=none --jobs 1

Prints per scene: sync error in % and frames, matched share, share within one frame, confidence.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.sync.map_scores import event_errors_frames, score_maps
from benchmarks.sync.scenes import SyncScene, protocol_scene, trial_scene
from benchmarks.sync.training_scenes import training_scenes
from imocap_core.params import SyncParams
from imocap_core.sync import SyncEvidence, synchronise

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("IMOCAP_DATA", ROOT.parent / "shared" / "data"))


def settings(changes: dict[str, Any]) -> SyncParams:
    """The defaults with changes."""
    return SyncParams(**changes)


def scenes_of(kind: str, seed: int) -> list[SyncScene]:
    """Scenes by kind."""
    if kind.startswith("protocol-"):
        files = sorted((DATA / "protocol").glob("*.npz"))
        return [protocol_scene(f, kind.removeprefix("protocol-"), seed=seed) for f in files]
    if kind == "trials":
        return [trial_scene(f, seed=seed) for f in sorted((DATA / "trials").glob("*.npz"))]
    return training_scenes(DATA / "train" / "cmu_train.npz", kind, seed)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="+")
    parser.add_argument("--set", nargs="*", default=[], dest="sets")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--videos", type=int, default=4)
    parser.add_argument("--only", default="")
    args = parser.parse_args()
    chosen = settings({k: yaml.safe_load(v) for k, v in (s.split("=") for s in args.sets)})
    for kind in args.kinds:
        rows = []
        for scene in scenes_of(kind, args.seed):
            if args.only not in scene.name:
                continue
            began = time.perf_counter()
            n = args.videos
            evidence = SyncEvidence(scene.poses[:n], scene.fps[:n])
            sync = synchronise(evidence, chosen, np.random.default_rng(0))
            took = time.perf_counter() - began
            score = score_maps(scene, sync.reference, sync.reference_frame, sync.confidence)
            rows.append(astuple(score))
            event = ""
            if scene.events is not None:
                errors = event_errors_frames(scene, sync.reference, sync.reference_frame)
                event = f"  event {np.array2string(np.sort(errors), precision=1)}"
            print(
                f"{scene.name:32s} N {scene.frames:5d} ref {sync.reference}  "
                + "{:6.2f} % {:6.2f} fr  matched {:.2f}  <=1 {:.2f}  conf {:.2f}".format(*rows[-1])
                + f"  {took:.1f} s{event}",
                flush=True,
            )
        mean = np.nanmean(rows, axis=0)
        print(
            f"== {kind:29s}          "
            + "{:6.2f} % {:6.2f} fr  matched {:.2f}  <=1 {:.2f}  conf {:.2f}".format(*mean)
        )


if __name__ == "__main__":
    main()
