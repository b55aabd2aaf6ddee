"""DeepLabCut's results, whatever file they come from: headings of the columns, a row per frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from imocap_core.body.layouts import layout_names
from imocap_core.io.detectors.part_names import matched_columns
from imocap_core.io.detectors.people import DetectedPeople, cleaned, detections

HEADINGS = ("scorer", "individuals", "bodyparts", "coords")
COORDS = ("x", "y", "likelihood")


@dataclass(frozen=True)
class DeepLabCutTable:
    """headings: row's name -> its C columns. values: pixels, likelihood; NaN where missing."""

    headings: dict[str, list[str]]
    frames: Int[np.ndarray, " N"]
    values: Float[np.ndarray, "N C"]

    @property
    def body_parts(self) -> list[str]:
        """The names of the body parts, in the order of the columns."""
        return list(dict.fromkeys(self.headings["bodyparts"]))


def people_of_table(table: DeepLabCutTable, layout: str, path: Path) -> DetectedPeople:
    """All individuals of all frames; ValueError when too few body parts are the layout's."""
    parts = table.body_parts
    columns = matched_columns(parts, layout, f"{path}: bodyparts")
    individuals = table.headings.get("individuals", [""] * len(table.headings["bodyparts"]))
    heading = zip(individuals, table.headings["bodyparts"], table.headings["coords"], strict=True)
    column_of = {of_whom: n for n, of_whom in enumerate(heading)}
    frames: dict[int, list[Float[np.ndarray, "K 3"]]] = {}
    for frame, values in zip(table.frames.tolist(), table.values, strict=True):
        frames[frame] = []
        for who in dict.fromkeys(individuals):
            person = np.full((len(layout_names(layout)), 3), np.nan)
            for column, part in columns.items():
                x, y, score = (column_of.get((who, parts[part], what)) for what in COORDS)
                if x is not None and y is not None:
                    likelihood = 1.0 if score is None else values[score]
                    person[column] = values[x], values[y], likelihood
            person = cleaned(person)
            if (person[:, 2] > 0).any():
                frames[frame].append(person)
    return detections(frames, layout, path)
