"""The coach's card: the largest differences of an action on one page, for a phone or for paper."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence

import cv2
import numpy as np

from imocap_core.artifacts.schemas import RefineSync
from imocap_core.body import Model
from imocap_core.diagnostics.findings import Verdict
from imocap_core.figures.overlays import CELL_PX, PAPER_RGB, Image
from imocap_core.figures.sheets import (
    SheetVideo,
    moment_cells,
    read_cells,
    upright_bodies,
    upright_world,
)
from imocap_core.figures.style import rgb_of
from imocap_core.render import common_scale, draw_view, view_rotation
from imocap_core.report.first_page import SureDifference
from imocap_core.report.page_files import badge, html_head, prose

CARD = "card.html"
_SHOWN = 3
_REFERENCE_RGB = (168, 174, 181)
_VIEWS = ("front", "side")
_QUALITY, _SOLID = 85, 0.68  # of WebP; of a ghost, the video's share
_OF_BONE = 0.5  # weight of the skin that a bone carries


def largest_differences(differences: Sequence[SureDifference]) -> list[SureDifference]:
    """At most three, the largest first: of different angles, as far as there are so many."""
    order = sorted(differences, key=lambda d: -d.size_deg)
    leading = {d.angle: d for d in reversed(order)}.values()
    chosen = sorted(order, key=lambda d: d not in leading)[:_SHOWN]
    return sorted(chosen, key=order.index)


def card_page(
    title: str,
    verdict: Verdict,
    differences: Sequence[SureDifference],
    videos: Sequence[SheetVideo],
    refined: RefineSync,
    model: Model,
) -> str | None:
    """The page; None where no angle differs for sure. Its pictures: the two frames, and the body
    over that of the reference."""
    chosen = largest_differences(differences)
    if not chosen:
        return None
    parts = [_section(k + 1, d, videos, refined, model) for k, d in enumerate(chosen)]
    reference = html.escape(refined.sync.reference)
    doubtful = verdict.level != "good" and len(verdict.summary) > 1
    doubt = f"<p>{prose(verdict.summary[1])}</p>" if doubtful else ""
    return (
        html_head(f"{html.escape(title)} · card", "card.css")
        + f"<h1>{html.escape(title)}{badge(verdict)}</h1>\n{doubt}"
        + "".join(parts)
        + f"<p>Grey: {reference}. ±: the expected error of the difference, one standard deviation."
        "</p></body></html>\n"
    )


def _section(
    number: int,
    difference: SureDifference,
    videos: Sequence[SheetVideo],
    refined: RefineSync,
    model: Model,
) -> str:
    ids = [video.keypoints.id for video in videos]
    names = (difference.video, refined.sync.reference)
    of = [
        (v, int(np.abs(videos[v].keypoints.frames - frame).argmin()))
        for v, frame in zip(map(ids.index, names), difference.frames, strict=True)
    ]
    pictures = []
    for (v, t), name in zip(of, names, strict=True):
        video = videos[v]
        cells, cuts = read_cells(video.keypoints, video.file, [t])
        (cell,) = moment_cells(video, [t], cells, cuts)
        pictures.append(_figure(cell, f"{name}, frame {video.keypoints.frames[t]}"))
    ghost, view = _ghost(difference.angle, of, videos, refined, model)
    pictures.append(_figure(ghost, f"{names[0]} over {names[1]}, from the {view}"))
    link = f'<a href="viewer.html#t={difference.phase_s:.2f}">In 3D</a>'
    return (
        f"<section><h2>{number}. {html.escape(difference.sentence)}</h2>\n"
        f'<div class="row">{"".join(pictures)}</div><p>{link}</p></section>\n'
    )


def _ghost(
    angle: str,
    of: Sequence[tuple[int, int]],
    videos: Sequence[SheetVideo],
    refined: RefineSync,
    model: Model,
) -> tuple[Image, str]:
    """Two bodies, (video, index of a frame) each, one seen through the other, facing one way, their
    pelvises above one place; from where the limb of the angle differs most in the picture."""
    ground, cameras = upright_world(refined), refined.motion.cameras
    weights = model.weights.numpy()
    bodies, headings = [], []
    for v, t in of:
        posed, facing = upright_bodies(videos[v].final, cameras[v], ground, model, [t])
        middle = posed[0][weights[:, 0] > _OF_BONE].mean(axis=0)
        bodies.append(posed[0] - [middle[0], posed[0][:, 1].min(), middle[2]])
        headings.append(facing[0])
    joint = "_".join(angle.split("_")[:2])
    bone = model.joint_names.index(joint) if joint in model.joint_names else slice(None)
    limb = weights[:, bone].reshape(len(weights), -1).max(axis=1) > _OF_BONE

    def apart(view: str) -> float:
        R = [view_rotation(heading, view)[:2] for heading in headings]
        return float(((bodies[0][limb] @ R[0].T - bodies[1][limb] @ R[1].T) ** 2).mean())

    view = max(_VIEWS, key=apart)
    scale = 0.85 * common_scale(np.stack(bodies), np.stack(headings), CELL_PX)
    middle_m = np.array([0.0, max(float(b[:, 1].max()) for b in bodies) / 2, 0.0])
    faces = model.faces.numpy()
    ids = [video.keypoints.id for video in videos]
    colors = (np.array(rgb_of(ids, ids[of[0][0]]), float), np.array(_REFERENCE_RGB, float))
    first, second = (
        draw_view(
            body, faces, np.tile(rgb, (len(faces), 1)), heading, view, CELL_PX, scale, middle_m
        ).astype(np.float64)
        for body, heading, rgb in zip(bodies, headings, colors, strict=True)
    )
    return (_SOLID * first + (1 - _SOLID) * second).astype(np.uint8), view


def _figure(picture: Image, caption: str) -> str:
    shown = (picture != np.array(PAPER_RGB, np.uint8)).any(axis=2, keepdims=True)
    bgra = np.concatenate([picture[:, :, ::-1], np.where(shown, 255, 0).astype(np.uint8)], axis=2)
    done, data = cv2.imencode(".webp", bgra, [cv2.IMWRITE_WEBP_QUALITY, _QUALITY])
    assert done
    source = f"data:image/webp;base64,{base64.b64encode(data.tobytes()).decode('ascii')}"
    text = html.escape(caption)
    return f'<figure><img src="{source}" alt="{text}"><figcaption>{text}</figcaption></figure>'
