"""Clips of Penn Action: hand-made labels in pixels, and groups of clips as actions.

The data is for evaluation alone. Frame rates are unknown; 30 frames a second are assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from jaxtyping import Bool, Float

from benchmarks.actions.action_folder import action_key, make_whole
from benchmarks.actions.captured import data_folder

LAYOUT, FPS = "penn13", 30.0
SEED, GROUP = 7, 4  # of the choice of clips; clips of a group
LEAST_FRAMES = 30
FILE = "penn_labels.npz"


@dataclass(frozen=True)
class Clip:
    """One clip: xy_px (T, 13, 2) labels in the order of `penn13`; visible (T, 13)."""

    id: int
    action: str
    size: tuple[int, int]
    xy_px: Float[np.ndarray, "T 13 2"]
    visible: Bool[np.ndarray, "T 13"]


def penn_clips(root: Path) -> list[Clip]:
    """All clips that are long enough. WorkFailed when the data is not there."""
    with np.load(data_folder(root, "penn") / FILE) as stored:
        table = {name: stored[name] for name in stored.files}
    xy, visible = table["xy16"] / 16.0, table["visible"].astype(bool)
    clips = []
    for k, (first, frames) in enumerate(zip(table["first"], table["frames"], strict=True)):
        span = slice(int(first), int(first + frames))
        width, height = (int(x) for x in table["size"][k])
        number, action = int(table["id"][k]), str(table["action"][k])
        if frames >= LEAST_FRAMES:
            clips.append(Clip(number, action, (width, height), xy[span], visible[span]))
    return clips


def groups_of(clips: Sequence[Clip], action: str, count: int) -> list[list[Clip]]:
    """Groups of clips of one action, no clip twice: the same ones for the same seed, and the first
    ones of a larger count."""
    of_action = sorted((c for c in clips if c.action == action), key=lambda c: c.id)
    order = np.random.default_rng(SEED).permutation(len(of_action))
    most = min(count, len(order) // GROUP)
    return [[of_action[k] for k in order[GROUP * g : GROUP * (g + 1)]] for g in range(most)]


def make_group(folder: Path, group: Sequence[Clip]) -> None:
    """An action folder whose videos are some clips."""

    def write(new: Path) -> None:
        (new / "keypoints").mkdir()
        videos = []
        for clip in group:
            name = f"c{clip.id:04d}"
            table = np.concatenate([clip.xy_px, clip.visible[..., None]], axis=-1)
            np.savez(new / "keypoints" / f"{name}.npz", keypoints=table)
            videos.append(
                {
                    "id": name,
                    "keypoints": f"keypoints/{name}.npz",
                    "format": "npz",
                    "layout": LAYOUT,
                    "fps": FPS,
                    "size": list(clip.size),
                }
            )
        action = {"name": folder.name, "videos": videos}
        (new / "action.yaml").write_text(yaml.safe_dump(action, sort_keys=False))

    ids = [[c.id, c.xy_px.tolist(), c.visible.tolist()] for c in group]
    make_whole(folder, action_key([folder.name, LAYOUT, FPS, ids], []), write)
