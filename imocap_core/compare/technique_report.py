"""The files of a technique report: one HTML page, and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from imocap_core.biomechanics.joint_angles import MeanCurve
from imocap_core.body import Shaped
from imocap_core.body.model import pose_from_rotations
from imocap_core.compare import compare, parts
from imocap_core.compare.parts import (
    Chance,
    chance_of,
    pair_findings,
    performer_names,
    technique_findings,
)
from imocap_core.errors import WorkFailed
from imocap_core.figures.style import VIDEO_COLORS
from imocap_core.motion.multiview.modes import Modes
from imocap_core.result.video import VideoResult
from imocap_core.technique import MotionDifference, plain_angle
from imocap_core.variation import Variation
from imocap_core.viewer import html as viewer
from imocap_core.viewer.html import Block, Entry, model_entry, shape_entry
from imocap_core.viewer.viewer_video import picture_entry, stride, windows

_MEAN_COLOR = "#6b7480"
_MOST_PICTURES = 400  # of all bodies together
_OF_VIEWER_ALONE = ("cards.js", "verdict.js", "chooser.js", "main.js")
_SHARED = tuple(name for name in viewer.SCRIPTS if name not in _OF_VIEWER_ALONE)
_OWN = ("compare.js",)
_PACKAGE = "imocap_core.compare"


@dataclass(frozen=True, eq=False)
class ShownBody:
    """A motion of the page: its name and colour, rotations (N, J, 3, 3) of SMPL's first J joints,
    joints (N, J, 3) in metres from the pelvis, y up; inside (N,): the moments that it shows."""

    name: str
    color: str
    R_local: Float[np.ndarray, "N J 3 3"]
    joints: Float[np.ndarray, "N J 3"]
    inside: Bool[np.ndarray, " N"]


@dataclass(frozen=True, eq=False)
class Filmed:
    """A body's video, and its source frame at each of the body's moments."""

    video: VideoResult
    frames: Int[np.ndarray, " N"]


def pair_page(
    pair: compare.TechniquePair,
    angles: tuple[compare.TechniqueAngles, compare.TechniqueAngles],
    findings: Sequence[MotionDifference],
    chance: Chance,
) -> str:
    """The page of two performers: their mean motions at the moments that both show."""
    names = performer_names(pair)
    first, second = (of.mean for of in angles)
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
        _words(f"{names[0]} and {names[1]}", lead, findings, _pair_notes(pair, chance)),
        pair.first.performances.shaped,
        pair.phase_s,
        bodies,
        curves,
    )


def _technique_page(
    t: compare.Technique,
    angles: compare.TechniqueAngles,
    findings: Sequence[MotionDifference],
    videos: Mapping[str, VideoResult],
    variation: Variation,
) -> str:
    """The page of an action's performances, and of their mean where there are more than two.

    videos: by id, for their pictures; there need not be any. variation: whose modes the mean can be
    moved along.
    """
    each = t.instances
    nothing = np.full(len(each.phase_s), np.nan)
    count = np.ones(len(each.phase_s), dtype=np.int64)
    bodies = [
        ShownBody("mean", _MEAN_COLOR, t.mean.R_local, t.mean.joints, each.shown > 0),
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
    lead = f"{len(each.ids)} performances and their mean"
    if len(each.ids) == 2:
        lead, bodies = f"{each.ids[0]} and {each.ids[1]}", bodies[1:]
        curves = {name: of[1:] for name, of in curves.items()}
    return _page(
        _words(
            t.action,
            f"{lead} at the same moments, on one body, facing one way",
            findings,
            _notes(t, variation),
        ),
        t.performances.shaped,
        each.phase_s,
        bodies,
        curves,
        _filmed(t, videos),
        variation.modes,
    )


def _filmed(t: compare.Technique, videos: Mapping[str, VideoResult]) -> dict[str, Filmed]:
    """The performances whose files are there."""
    each, shown = t.instances, {}
    for m, name in enumerate(each.ids):
        video = videos.get(name)
        if video is not None and video.video is not None:
            index = np.rint(t.performances.clock_s[m, each.inside[m]] * video.fps).astype(np.int64)
            frames = video.frames[np.clip(index, 0, len(video.frames) - 1)]
            shown[name] = Filmed(video, frames.astype(np.int64))
    return shown


def _words(
    title: str, lead: str, findings: Sequence[MotionDifference], notes: Sequence[str]
) -> dict[str, Any]:
    """The words of a page; notes are what it says in numbers."""
    listed = [{"text": f.sentence, "at": f.phase_s, "angle": f.angle} for f in findings]
    return {"title": title, "lead": lead, "notes": list(notes), "findings": listed}


def _page(
    words: Mapping[str, Any],
    shaped: Shaped,
    phase_s: Float[np.ndarray, " N"],
    bodies: Sequence[ShownBody],
    curves: Mapping[str, Sequence[MeanCurve]],
    filmed: Mapping[str, Filmed] | None = None,
    modes: Modes | None = None,
) -> str:
    """modes: of the first body, which shows all moments."""
    block, filmed = Block(), filmed or {}
    every = stride([len(each.frames) for each in filmed.values()], _MOST_PICTURES)
    step = float(np.median(np.diff(phase_s))) if len(phase_s) > 1 else 1.0
    ends = {"first": float(phase_s[0]), "last": float(phase_s[-1])}
    header = {
        **words,
        "legend": "grid 0.5 m · click joints to measure",
        "reference": "the common time",
        "timeline": {**ends, "step": step, "shared": ends["first"]},
        "model": model_entry(block, shaped.model),
        "shapes": [shape_entry(block, shaped)],
        "middle": [0.0, 1.0, 0.0],
        "azimuth": 0.5,
        "right": [1.0, 0.0, 0.0],
        "phase": block.add(phase_s, "f4"),
        "videos": [
            _body_entry(block, shaped, phase_s, step, body)
            | _picture_entry(block, filmed.get(body.name), every)
            for body in bodies
        ],
        "angles": [
            {"name": n, "label": plain_angle(n), "curves": [_curve_entry(block, c) for c in of]}
            for n, of in curves.items()
        ],
        "modes": [
            {"share": float(share), "turns": block.add(turns, "f4")}
            for share, turns in (
                [] if modes is None else zip(modes.share, modes.turns, strict=True)
            )
        ],
    }
    return viewer.filled(
        header,
        block,
        "comparison",
        viewer.source("compare.html", _PACKAGE),
        viewer.source("style.css") + viewer.source("compare.css", _PACKAGE),
        viewer.joined(_SHARED) + viewer.joined(_OWN, _PACKAGE),
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
    theta = pose_from_rotations(torch.as_tensor(compare.in_smpl(R))).numpy()
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


def _picture_entry(block: Block, filmed: Filmed | None, every: int) -> dict[str, Any]:
    """The source frames of a body's moments; nothing where its file is not there."""
    file = None if filmed is None else filmed.video.video
    if filmed is None or file is None:
        return {"pictures": None}
    video, lens = filmed.video, filmed.video.camera.lens
    (window,) = windows([video.keypoints.person_box_px], [video.camera.size])
    pictures = picture_entry(block, file, filmed.frames, every, window, lens)
    frames = block.add(filmed.frames, "i4")
    return {"pictures": pictures, "frames": frames, "view": list(window)}


def _curve_entry(block: Block, curve: MeanCurve) -> dict[str, Entry | None]:
    banded = bool(np.isfinite(curve.sd_deg).any())
    return {
        "mean": block.add(curve.mean_deg, "f4"),
        "sd": block.add(curve.sd_deg, "f4") if banded else None,
    }


def write_technique(
    out: Path, t: compare.Technique, videos: Mapping[str, VideoResult] | None = None
) -> list[Path]:
    """report.html, joints.csv and performances.csv; the report first.

    videos: by id, for their pictures beside the bodies.
    """
    each, names = t.instances, t.instances.joint_names
    _make_folder(out)
    parts.write_course(
        out / "joints.csv", each.phase_s, names,
        {"spread_deg": t.spread_deg, "spread_mm": t.spread_mm},
    )  # fmt: skip
    scores = {f"mode{k + 1}_sd": t.modes.scores[:, k] for k in range(len(t.modes.share))}
    parts.write_performances(
        out / "performances.csv", each.ids, {"distance_mm": _from_mean_mm(t), **scores}
    )
    angles = compare.technique_angles(t)
    findings, variation = technique_findings(t, angles), compare.variation_of(t, angles.mean)
    page = _technique_page(t, angles, findings, videos or {}, variation)
    (out / "report.html").write_text(page, encoding="utf-8")
    return [out / x for x in ("report.html", "joints.csv", "performances.csv")]


def _from_mean_mm(t: compare.Technique) -> Float[np.ndarray, " M"]:
    """(M,) root mean square distance of a performance from the mean, over joints and moments."""
    squares = (t.mean.shifts**2).sum(-1).mean(-1)
    shown = np.maximum(t.instances.inside.sum(1), 1)
    return np.asarray(1000 * np.sqrt(squares.sum(1) / shown))


def _notes(t: compare.Technique, variation: Variation) -> list[str]:
    """What the page says in numbers: consistency, modes, the joints that differ most."""
    names = t.instances.joint_names
    most = parts.moment_sentences(t.instances.phase_s, t.spread_mm, names, "mm")
    return [
        f"Consistency {parts.number(t.consistency, 3)} (1: equal, 0: no more alike than unrelated "
        "moments).",
        *parts.mode_sentences(t.modes, names),
        parts.modes_known(variation),
        f"Standard deviation of places, largest: {'; '.join(most)}.",
        *(f"Left out: {video}." for video in t.performances.left_out),
    ]


def _make_folder(out: Path) -> None:
    """Make the folder; WorkFailed when it cannot be made."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WorkFailed(f"cannot write to {out}: {error.strerror}") from None


def write_pair(out: Path, pair: compare.TechniquePair) -> list[Path]:
    """report.html and joints.csv of two performers; the report first."""
    _make_folder(out)
    parts.write_course(
        out / "joints.csv", pair.phase_s, pair.first.instances.joint_names,
        {
            "angle_deg": pair.difference.angle_deg,
            "distance_mm": pair.difference.distance_mm,
            "times_spread": pair.difference.ratio,
            "second_phase_s": np.repeat(
                pair.second_s[:, None], pair.difference.angle_deg.shape[1], axis=1
            ),
        },
    )  # fmt: skip
    angles = compare.pair_angles(pair)
    chance = chance_of(angles[0].each, angles[1].each, np.random.default_rng(0))
    page = pair_page(pair, angles, pair_findings(pair, angles, chance), chance)
    (out / "report.html").write_text(page, encoding="utf-8")
    return [out / "report.html", out / "joints.csv"]


def _pair_notes(pair: compare.TechniquePair, chance: Chance) -> list[str]:
    distance, names = pair.difference.distance_mm, pair.first.instances.joint_names
    first, second = performer_names(pair)
    most = parts.moment_sentences(pair.phase_s, distance, names, "mm")
    return [
        parts.chance_sentence(pair, chance),
        f"They share {len(pair.phase_s)} of {len(pair.first.instances.phase_s)} moments of "
        f"{first}'s time axis, {pair.phase_s[0]:.2f} to {pair.phase_s[-1]:.2f} s; {second}'s are "
        f"{pair.second_s[0]:.2f} to {pair.second_s[-1]:.2f} s.",
        f"Distance of places, largest: {'; '.join(most)}.",
    ]
