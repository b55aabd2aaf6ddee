"""The truth of a collected action, and the same takes as clean clips, for scoring the motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.collect.edit import SIZE, CutPiece
from benchmarks.collect.takes import SIZE as TAKE_SIZE
from benchmarks.collect.truth import shown_by
from imocap_core.collect.listing import CollectedList, ListedOccurrence
from imocap_core.conventions import SMPL_JOINTS
from imocap_core.pipeline.action import FILE_NAME

TRUTH = "truth.npz"
ROWS = ("joints", "phase", "theta", "trans")


def add_truth(
    folder: Path, collected: CollectedList, films: Mapping[int, Sequence[CutPiece]]
) -> None:
    """Write the truth of a collected action's videos beside it; a mirrored video has none."""
    parts: dict[str, Any] = {"joint_names": np.array(SMPL_JOINTS)}
    ends = []
    for occurrence, place, file in _takes_shown(collected, films):
        with np.load(file.with_suffix(".npz")) as stored:
            take = dict(stored)
        ends.append(float(take["phase"][-1]))
        parts["model"] = take["model"]
        if not place.piece.mirrored:
            rows = _rows(occurrence, place, len(take["phase"]))
            parts |= {f"{occurrence.id}/{name}": take[name][rows] for name in ROWS}
            parts |= {f"{occurrence.id}/{name}": take[name] for name in ("R", "t", "betas")}
            parts[f"{occurrence.id}/K"] = on_canvas(place.piece.zoom) @ take["K"]
            parts[f"{occurrence.id}/frames"] = np.arange(*occurrence.frames)
    parts["phase_end"] = max(ends)
    np.savez(folder / TRUTH, **parts)
    file = folder / FILE_NAME
    file.write_text(f"{file.read_text(encoding='utf-8')}truth: {TRUTH}\n", encoding="utf-8")


def _takes_shown(
    collected: CollectedList, films: Mapping[int, Sequence[CutPiece]]
) -> Iterator[tuple[ListedOccurrence, CutPiece, Path]]:
    """Each chosen occurrence that shows a take, with its piece and the take's file."""
    for occurrence in collected.chosen:
        place = shown_by(occurrence, films[occurrence.film])
        if place is not None and place.piece.file is not None and place.piece.shown is not None:
            yield occurrence, place, place.piece.file


def _rows(occurrence: ListedOccurrence, place: CutPiece, count: int) -> np.ndarray:
    """The take's pictures that the occurrence's frames show."""
    piece = place.piece
    number = np.arange(*occurrence.frames) - place.first + place.source_first
    begin = 0 if piece.span is None else piece.span[0]
    return np.clip(begin + (number // piece.repeat) * piece.step, 0, count - 1)


def on_canvas(zoom: float) -> np.ndarray:
    """Pixels of a compilation from those of a take."""
    right, down = (SIZE[0] - TAKE_SIZE[0] * zoom) / 2, SIZE[1] - TAKE_SIZE[1] * zoom
    return np.array([[zoom, 0, right], [0, zoom, down], [0, 0, 1.0]])


def clean_action(
    folder: Path, collected: CollectedList, films: Mapping[int, Sequence[CutPiece]]
) -> None:
    """The action of the same takes, each a film of its own of which the same part is used, with
    their truth, in a new folder."""
    folder.mkdir(parents=True, exist_ok=True)
    parts: dict[str, Any] = {"joint_names": np.array(SMPL_JOINTS)}
    videos, ends = [], []
    for occurrence, place, file in _takes_shown(collected, films):
        with np.load(file.with_suffix(".npz")) as stored:
            take = dict(stored)
        ends.append(float(take["phase"][-1]))
        parts["model"] = take.pop("model")
        parts |= {f"{occurrence.id}/{name}": value for name, value in take.items()}
        rows = _rows(occurrence, place, len(take["phase"]))
        parts[f"{occurrence.id}/frames"] = np.arange(len(take["phase"]))
        videos.append(
            {
                "id": occurrence.id,
                "video": str(file.resolve()),
                "keypoints": "detect",
                "frames": [int(rows.min()), int(rows.max()) + 1],
            }
        )
    parts["phase_end"] = max(ends)
    np.savez(folder / TRUTH, **parts)
    action = {"name": folder.name, "videos": videos, "truth": TRUTH}
    (folder / FILE_NAME).write_text(yaml.safe_dump(action, sort_keys=False), encoding="utf-8")
