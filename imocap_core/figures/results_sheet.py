"""The same frames under several results: monocular, one motion for all videos, final."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

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
from imocap_core.workers import at_once

COLUMNS = 6


@dataclass(frozen=True)
class SheetResult:
    """Motions in the order of the videos, and the intrinsics of each by video id."""

    name: str
    motions: Sequence[VideoMotion]
    K: Mapping[str, Float[np.ndarray, "3 3"]]


def most_different_frames(first: VideoMotion, last: VideoMotion, count: int) -> list[int]:
    """In each of `count` equal parts of a video the frame in which two results differ most."""
    a, b = (m.joints - m.joints[:, :1] for m in (first, last))
    apart = np.linalg.norm(a - b, axis=-1).mean(axis=1)
    parts = np.array_split(np.arange(len(apart)), min(count, len(apart)))
    return [int(part[apart[part].argmax()]) for part in parts]


def picks_of(videos: Sequence[SheetVideo]) -> list[tuple[int, int]]:
    """(video, index of a used frame) per column: where monocular and final motion differ most."""
    each = max(1, COLUMNS // len(videos))
    return [
        (v, t)
        for v, video in enumerate(videos[:COLUMNS])
        for t in most_different_frames(video.monocular, video.final, each)
    ]


def results_sheet(
    videos: Sequence[SheetVideo],
    results: Sequence[SheetResult],
    picks: Sequence[tuple[int, int]],
    cells: Mapping[str, Mapping[int, Image]],
    cuts: Mapping[str, Mapping[int, Window]],
    model: Model,
) -> Figure:
    """One column per pick; each result in a row over the frame and a row from the side."""
    faces = model.faces.numpy()

    def rows(result: SheetResult) -> tuple[list[Image], list[Image]]:
        row, bodies = [], []
        for v, t in picks:
            camera, video = videos[v].camera, videos[v].keypoints.id
            in_first = surfaces(model, result.motions[v], [t])[0]
            body = in_first @ camera.R_first_from_frame[t]  # R^T x: axes of frame t
            K = lens_of(result.K[video], camera.zoom[t])
            filmed, K_cell = videos[v].filmed(body, K), cuts[video][t].camera(K)
            row.append(draw_body(cells[video][t], filmed, faces, K_cell))
            bodies.append(body)
        return row, from_the_side(np.stack(bodies), faces)

    over, side = zip(*at_once(rows, results), strict=True)
    return contact_sheet(
        [*over, *side],
        [*(r.name for r in results), *(f"{r.name},\nfrom the side" for r in results)],
        [f"{videos[v].keypoints.id} frame {videos[v].keypoints.frames[t]}" for v, t in picks],
        "The same frames under each result",
        "frames in which the first and the last result differ most; "
        "from the side: depth, which the picture hides",
    )
