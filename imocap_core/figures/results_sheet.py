"""The same frames under several answers: what one video says, one motion for all, the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from imocap_core.artifacts.schemas import VideoMotion
from imocap_core.body import Model
from imocap_core.camera.zooming import lens_of
from imocap_core.figures.bodies import surfaces
from imocap_core.figures.contact_sheets import SheetVideo
from imocap_core.figures.overlays import (
    Image,
    Window,
    contact_sheet,
    draw_body,
    from_the_side,
)

Array = NDArray[np.float64]

COLUMNS = 6


@dataclass(frozen=True)
class SheetResult:
    """An answer: motions in the order of the videos, and the intrinsics (3, 3) they project by."""

    name: str
    motions: Sequence[VideoMotion]
    K: Mapping[str, Array]


def most_different_frames(first: VideoMotion, last: VideoMotion, count: int) -> list[int]:
    """Of each of `count` equal parts of a video the frame in which two answers differ most."""
    a, b = (m.joints - m.joints[:, :1] for m in (first, last))
    apart = np.linalg.norm(a - b, axis=-1).mean(axis=1)
    parts = np.array_split(np.arange(len(apart)), min(count, len(apart)))
    return [int(part[apart[part].argmax()]) for part in parts]


def picks_of(shots: Sequence[SheetVideo]) -> list[tuple[int, int]]:
    """(video, index of a used frame) of each column: where monocular and final differ most."""
    each = max(1, COLUMNS // len(shots))
    return [
        (v, t)
        for v, shot in enumerate(shots[:COLUMNS])
        for t in most_different_frames(shot.first, shot.last, each)
    ]


def results_sheet(
    shots: Sequence[SheetVideo],
    results: Sequence[SheetResult],
    picks: Sequence[tuple[int, int]],
    cells: Mapping[str, Mapping[int, Image]],
    where: Mapping[str, Mapping[int, Window]],
    model: Model,
) -> Figure:
    """A column a pick; a row an answer over the frame, and a row an answer from the side."""
    faces = model.faces.numpy()
    over, side = [], []
    for result in results:
        row, bodies = [], []
        for v, t in picks:
            shot = shots[v]
            in_first = surfaces(model, result.motions[v], [t])[0]
            body = in_first @ shot.camera.R_first_from_frame[t]  # R^T x: axes of frame t
            video = shot.seen.id
            K = lens_of(result.K[video], shot.camera.zoom[t])
            row.append(draw_body(cells[video][t], body, faces, where[video][t].camera(K)))
            bodies.append(body)
        over.append(row)
        side.append(from_the_side(np.stack(bodies), faces))
    return contact_sheet(
        [*over, *side],
        [*(r.name for r in results), *(f"{r.name},\nfrom the side" for r in results)],
        [f"{shots[v].seen.id} frame {shots[v].seen.frames[t]}" for v, t in picks],
        "The same frames under each answer",
        "frames in which the first and the last answer differ most; "
        "from the side: what the picture cannot show",
    )
