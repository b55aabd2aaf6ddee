"""A comparison as one HTML page: bodies on one timeline, angle curves with bands, measuring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float

from imocap_core.biomechanics.mean_curve import MeanCurve
from imocap_core.body import Shaped
from imocap_core.body.conversions import pose_from_rotations
from imocap_core.compare.angles import Curves, TechniqueAngles, in_smpl
from imocap_core.compare.compare import Technique, TechniquePair
from imocap_core.compare.figures import in_words
from imocap_core.compare.words import (
    MotionDifference,
    performer_names,
)
from imocap_core.figures.style import VIDEO_COLORS
from imocap_core.viewer import html as viewer
from imocap_core.viewer.block import Block, Entry
from imocap_core.viewer.body import model_entry, shape_entry

MEAN_COLOR = "#6b7480"
OF_VIEWER_ALONE = ("pictures.js", "cards.js", "chooser.js", "main.js")
SHARED = tuple(name for name in viewer.SCRIPTS if name not in OF_VIEWER_ALONE)
OWN = ("measure.js", "compare.js")
PACKAGE = "imocap_core.compare"


@dataclass(frozen=True, eq=False)
class ShownBody:
    """A motion of the page: its name and colour, rotations (N, J, 3, 3) of SMPL's first J joints,
    joints (N, J, 3) in metres from the pelvis, y up; inside (N,): the moments that it shows."""

    name: str
    color: str
    R_local: Float[np.ndarray, "N J 3 3"]
    joints: Float[np.ndarray, "N J 3"]
    inside: Bool[np.ndarray, " N"]


def pair_page(
    pair: TechniquePair, angles: tuple[Curves, Curves], findings: Sequence[MotionDifference]
) -> str:
    """The page of two performers: their mean motions at the moments that both show."""
    names = performer_names(pair)
    first, second = angles
    shown = np.ones(len(pair.phase_s), dtype=bool)
    bodies = [
        ShownBody(name, color, R, joints, shown)
        for name, color, R, joints in zip(
            names, VIDEO_COLORS, pair.rotations, pair.joints, strict=False
        )
    ]
    curves = {name: [first[name], second[name]] for name in first}
    lead = (
        f"Mean motions of {names[0]} ({len(pair.first.instances.ids)} performances) and {names[1]} "
        f"({len(pair.second.instances.ids)}) at equal phases, on one body, facing one way"
    )
    return _page(
        f"{names[0]} and {names[1]}",
        lead,
        pair.first.performances.shaped,
        pair.phase_s,
        bodies,
        curves,
        findings,
    )


def technique_page(
    t: Technique, angles: TechniqueAngles, findings: Sequence[MotionDifference]
) -> str:
    """The page of an action's performances and their mean."""
    each = t.instances
    nothing = np.full(len(each.phase_s), np.nan)
    count = np.ones(len(each.phase_s), dtype=np.int64)
    bodies = [
        ShownBody("mean", MEAN_COLOR, t.mean.R_local, t.mean.joints, each.shown > 0),
        *(
            ShownBody(video, VIDEO_COLORS[m % len(VIDEO_COLORS)], R, joints, inside)
            for m, (video, R, joints, inside) in enumerate(
                zip(each.ids, each.R_local, each.joints, each.inside, strict=True)
            )
        ),
    ]
    curves = {
        name: [mean, *(MeanCurve(row, nothing, count) for row in angles.each[name])]
        for name, mean in angles.mean.items()
    }
    return _page(
        t.action,
        f"{len(each.ids)} performances and their mean at equal phases, on one body, facing one way",
        t.performances.shaped,
        each.phase_s,
        bodies,
        curves,
        findings,
    )


def _page(
    title: str,
    lead: str,
    shaped: Shaped,
    phase_s: Float[np.ndarray, " N"],
    bodies: Sequence[ShownBody],
    curves: Mapping[str, Sequence[MeanCurve]],
    findings: Sequence[MotionDifference],
) -> str:
    block = Block()
    step = float(np.median(np.diff(phase_s))) if len(phase_s) > 1 else 1.0
    ends = {"first": float(phase_s[0]), "last": float(phase_s[-1])}
    header = {
        "title": title,
        "lead": lead,
        "legend": "grid 0.5 m · click joints to measure",
        "reference": "the common time",
        "timeline": {**ends, "step": step, "shared": ends["first"]},
        "model": model_entry(block, shaped.model),
        "shapes": [shape_entry(block, shaped)],
        "middle": [0.0, 1.0, 0.0],
        "azimuth": 0.5,
        "right": [1.0, 0.0, 0.0],
        "phase": block.add(phase_s, "f4"),
        "videos": [_body_entry(block, shaped, phase_s, step, body) for body in bodies],
        "angles": [
            {"name": n, "label": in_words(n), "curves": [_curve_entry(block, c) for c in of]}
            for n, of in curves.items()
        ],
        "findings": [{"text": f.sentence, "at": f.phase_s, "angle": f.angle} for f in findings],
    }
    return viewer.filled(
        header,
        block,
        "comparison",
        viewer.source("compare.html", PACKAGE),
        viewer.source("style.css") + viewer.source("compare.css", PACKAGE),
        viewer.joined(SHARED) + viewer.joined(OWN, PACKAGE),
    )


def _body_entry(
    block: Block, shaped: Shaped, phase_s: Float[np.ndarray, " N"], step: float, body: ShownBody
) -> dict[str, Any]:
    """As a video of the viewer: its pelvis over the origin, its lowest joint on the floor."""
    R, joints = body.R_local[body.inside], body.joints[body.inside]
    rest = shaped.joints_rest.numpy()
    sole = rest[:, 1].min() - shaped.vertices_rest.numpy()[:, 1].min()
    trans = np.zeros((len(R), 3)) - rest[0]
    trans[:, 1] += sole - joints[..., 1].min(axis=1)
    theta = pose_from_rotations(torch.as_tensor(in_smpl(R))).numpy()
    answer = {"shape": 0, "local": block.add(theta, "f4"), "trans": block.add(trans, "f4")}
    return {
        "id": body.name,
        "color": body.color,
        "fps": 1 / step,
        "excluded": False,
        "phase": block.add(phase_s[body.inside], "f4"),
        "confidence": block.add(np.full(len(R), 255), "u1"),
        "answers": {"final": answer},
        "sigma": None,
    }


def _curve_entry(block: Block, curve: MeanCurve) -> dict[str, Entry | None]:
    banded = bool(np.isfinite(curve.sd_deg).any())
    return {
        "mean": block.add(curve.mean_deg, "f4"),
        "sd": block.add(curve.sd_deg, "f4") if banded else None,
    }
