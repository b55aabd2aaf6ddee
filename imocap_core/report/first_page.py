"""What a person who films wants to know, in degrees and plain words: the report's first page, and
the coach's card with the largest differences on one page, for a phone or for paper."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from imocap_core.artifacts.schemas import RefineSync
from imocap_core.artifacts.store import Stored
from imocap_core.biomechanics.joint_angles import near
from imocap_core.body import Model
from imocap_core.diagnostics.findings import Verdict
from imocap_core.errors import ImocapError, WorkFailed
from imocap_core.figures import sheets
from imocap_core.figures.overlays import CELL_PX, PAPER_RGB, Image
from imocap_core.figures.page_figures import key_angle_figure
from imocap_core.figures.style import color_of, rgb_of
from imocap_core.pipeline.generation import LAST_RUN
from imocap_core.pipeline.runner import Job
from imocap_core.render import common_scale, draw_view, view_rotation
from imocap_core.report.page_files import badge, html_head, prose
from imocap_core.result.artifacts import artifacts_of_stages
from imocap_core.result.read import read_result
from imocap_core.result.result import ActionResult
from imocap_core.result.video import VideoResult
from imocap_core.result.video_motion import video_angles
from imocap_core.technique import SD_APART, SHOWN, degrees, largest, plain_angle, without_side

ANGLES = "angles.png"
_KEY_ANGLES = 3  # left and right of each
_SINKS_M = 0.12  # a pelvis that moves up and down by more has a lowest moment worth a name
_COLUMNS = 4  # videos that the table shows each by itself
_SENTENCES_OF_TWO, _SENTENCES = 4, 5
Curves = dict[str, Float[np.ndarray, "M N"]]  # degrees of M videos at N moments


@dataclass(frozen=True)
class SureDifference:
    """Where an angle of a video differs from the reference's by more than its error.

    frames: source frame numbers, of the video and of the reference. size_deg, error_deg: of the
    difference, the error one standard deviation.
    """

    sentence: str
    video: str
    angle: str
    phase_s: float
    frames: tuple[int, int]
    size_deg: float
    error_deg: float


@dataclass(frozen=True, eq=False)
class FirstPage:
    """The key angles of an action.

    moment: which moment the table is of, in words. head, rows: the table. differences: where the
    videos' angles differ by more than their error. figure: the angles over time. since: what has
    changed since the last run; empty where nothing has.
    """

    moment: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    differences: tuple[SureDifference, ...]
    figure: Figure
    since: str = ""


def first_page(result: ActionResult, before: ActionResult | None) -> FirstPage | None:
    """The first page of a result; None when no video has a place on the common time axis.

    before: the last run's result, if this one differs.
    """
    level = result.levelled("y")
    try:
        common = level.on_common_time()
    except WorkFailed:
        return None
    videos = common.videos
    each = [video_angles(video, "y", level.ground.tilt_sd_deg) for video in videos]
    inside = np.stack([video.inside for video in videos])
    curves = {}
    for name in SHOWN:  # NaN where a video does not show the moment, all by the same whole turns
        shown = np.where(inside, np.stack([a.angles_deg[name] for a in each]), np.nan)
        curves[name] = np.stack([near(curve, shown[0]) for curve in shown])
    unknown = np.full(inside.shape[1], np.nan)
    sd = {name: np.stack([a.sd_deg.get(name, unknown) for a in each]) for name in SHOWN}
    names = _key_angles(curves)
    t, words = _key_moment(videos, inside, curves[names[0]], names[0])
    phase_s = videos[0].phase_s
    ids = [video.id for video in videos]
    colors = [color_of(result.ids, video) for video in ids]
    frames = ", ".join(f"{v.id} frame {v.frames[t]:.0f}" for v in videos if v.inside[t])
    return FirstPage(
        moment=f"{words}, at {phase_s[t]:.2f} s ({frames})",
        head=(
            "angle",
            *(ids if len(ids) <= _COLUMNS else ("lowest", "middle", "highest")),
            "expected error",
            "whole action",
        ),
        rows=tuple(_row(name, curves[name], sd[name], t) for name in names),
        differences=tuple(differences(videos, result.reference, curves, sd)),
        figure=key_angle_figure(
            ids, phase_s, {name: curves[name] for name in names}, colors, float(phase_s[t])
        ),
        since="" if before is None else f"Since the last run: {compared(before, result)}",
    )


def _key_angles(curves: Curves) -> list[str]:
    """The angles that change most, both sides of each; the one that changes most first."""
    ranges = {name: max(map(_range_deg, each)) for name, each in curves.items()}
    order = sorted(ranges, key=lambda name: -ranges[name])
    plain = list(dict.fromkeys(without_side(name) for name in order))[:_KEY_ANGLES]
    return [name for title in plain for name in order if without_side(name) == title]


def _range_deg(angle: Float[np.ndarray, " N"]) -> float:
    shown = angle[np.isfinite(angle)]
    return float(np.ptp(shown)) if len(shown) else 0.0


def _key_moment(
    videos: Sequence[VideoResult],
    inside: Bool[np.ndarray, "M N"],
    angle: Float[np.ndarray, "M N"],
    name: str,
) -> tuple[int, str]:
    """The index of the moment to read angles at, and what it is: where the hips are lowest when
    they sink, else where an angle (M, N) is largest. It is one that most videos show."""
    shown = inside.sum(axis=0)
    most = shown == shown.max()
    height = np.mean([video.body_joints[:, 0, 1] for video in videos], axis=0)
    if np.ptp(height[most]) > _SINKS_M:
        return int(np.argmin(np.where(most, height, np.inf))), "Where the hips are lowest"
    mean = np.where(most, np.nan_to_num(angle, nan=-np.inf).max(axis=0), -np.inf)
    return int(np.argmax(mean)), f"Where the angle \u201c{plain_angle(name)}\u201d is largest"


def _row(
    name: str, each: Float[np.ndarray, "M N"], sd: Float[np.ndarray, "M N"], t: int
) -> tuple[str, ...]:
    now = each[:, t]
    if len(now) > _COLUMNS:
        shown = now[np.isfinite(now)]
        now = np.array([shown.min(), np.median(shown), shown.max()]) if len(shown) else now[:3]
    errors = sd[np.isfinite(sd[:, t]), t]
    error = f"± {errors.mean():.0f}°" if len(errors) else "not known"
    span = f"{degrees(float(np.nanmin(each)))} to {degrees(float(np.nanmax(each)))}"
    return (plain_angle(name), *(degrees(float(x)) for x in now), error, span)


def differences(
    videos: Sequence[VideoResult], reference: str, curves: Curves, sd: Curves
) -> list[SureDifference]:
    """Where videos on the common time differ most from the reference, by more than `SD_APART`
    expected errors."""
    ids = [video.id for video in videos]
    if reference not in ids:
        return []
    r = ids.index(reference)
    against, phase_s = {name: each[r] for name, each in curves.items()}, videos[r].phase_s
    sure: list[SureDifference] = []
    for m, video in enumerate(videos):
        if m == r:
            continue
        error = {
            name: np.hypot(np.nan_to_num(of[m]), np.nan_to_num(of[r])) for name, of in sd.items()
        }
        apart = {name: np.abs(each[m] - each[r]) for name, each in curves.items()}
        far = {
            name: np.where(apart[name] > SD_APART * error[name], each[m], np.nan)
            for name, each in curves.items()
        }
        largest_first = largest(video.id, reference, phase_s, far, against, {})
        for difference in largest_first[: _SENTENCES_OF_TWO if len(ids) == 2 else 2]:
            assert difference.angle is not None
            t = int(np.flatnonzero(phase_s == difference.phase_s)[0])
            frames = (round(float(video.frames[t])), round(float(videos[r].frames[t])))
            size, deg = float(apart[difference.angle][t]), float(error[difference.angle][t])
            text = difference.sentence.replace("), at", f", ± {deg:.0f}°), at")
            where = (video.id, difference.angle, difference.phase_s, frames)
            sure.append(SureDifference(text, *where, size, deg))
    return sure[:_SENTENCES]


def last_result(job: Job, stored: Mapping[str, Stored]) -> ActionResult | None:
    """The result of the last recorded run, from the cache; None where that is this result, or the
    cache no longer has it."""
    store, name = job.store, job.action.name
    try:
        record = json.loads((store.folder / name / LAST_RUN).read_text(encoding="utf-8"))
        keys = {entry["stage"]: str(entry["key"]) for entry in record["stages"]}
        digests = {entry["stage"]: entry["digest"] for entry in record["stages"]}
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
    if digests.get("refine_sync") == stored["refine_sync"].digest:
        return None
    cached = {s: store.find(name, s, keys[s]) for s in stored if keys.get(s, "").isalnum()}
    results = {stage: result for stage, result in cached.items() if result}
    try:
        return read_result(artifacts_of_stages(name, results), ActionResult)
    except ImocapError:
        return None


def compared(before: ActionResult | None, after: ActionResult) -> str:
    """A sentence on what a change was worth: the videos that came and went, how far the motion of
    the others has moved, and the expected errors."""
    was = after.ids if before is None else before.ids
    changes = [f"+{i}" for i in after.ids if i not in was]
    changes += [f"-{i}" for i in was if i not in after.ids]
    named = f" ({' '.join(changes)})" if changes else ""
    parts = [f"{len(after.ids)} video{'s' * (len(after.ids) != 1)}{named}"]
    moved, errors = moved_mm(before, after), [expected_error_mm(r) for r in (before, after)]
    if moved is not None:
        parts.append(f"the motion of {'the others' if changes else 'all'} moved by {moved:.0f} mm")
    if errors[1] is not None:
        then = "" if errors[0] is None else f" ({errors[0]:.0f} before)"
        parts.append(f"expected error {errors[1]:.0f} mm{then}")
    return "; ".join(parts) + "."


def moved_mm(before: ActionResult | None, after: ActionResult) -> float | None:
    """Mean distance of root-relative joints of the videos in both results, in camera axes."""
    if before is None:
        return None
    distances = []
    for video in after:
        if video.id not in before.ids or before[video.id].joints.shape != video.joints.shape:
            continue
        joints_m = [
            np.einsum("tij,tkj->tki", v.camera.R_per_frame, v.joints - v.joints[:, :1])
            for v in (before[video.id], video)
        ]
        distances.append(np.linalg.norm(joints_m[0] - joints_m[1], axis=-1).mean())
    return 1000 * float(np.mean(distances)) if distances else None


def expected_error_mm(result: ActionResult | None) -> float | None:
    """Mean standard deviation of all joints; None before the stage uncertainty has run."""
    videos = () if result is None else result
    sds = [video.uncertainty for video in videos if video.uncertainty is not None]
    return float(np.mean([np.nanmean(sd) for sd in sds])) if sds else None


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
    videos: Sequence[sheets.SheetVideo],
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
    videos: Sequence[sheets.SheetVideo],
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
        cells, cuts = sheets.read_cells(video.keypoints, video.file, [t])
        (cell,) = sheets.moment_cells(video, [t], cells, cuts)
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
    videos: Sequence[sheets.SheetVideo],
    refined: RefineSync,
    model: Model,
) -> tuple[Image, str]:
    """Two bodies, (video, index of a frame) each, one seen through the other, facing one way, their
    pelvises above one place; from where the limb of the angle differs most in the picture."""
    ground, cameras = sheets.upright_world(refined), refined.motion.cameras
    weights = model.weights.numpy()
    bodies, headings = [], []
    for v, t in of:
        posed, facing = sheets.upright_bodies(videos[v].final, cameras[v], ground, model, [t])
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
