"""The files of a technique report: Markdown, tables, pictures, and the mean motion as BVH."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.figure import Figure

from imocap_core.body.model import Shaped
from imocap_core.compare import figures, text
from imocap_core.compare.angles import in_smpl, technique_angles
from imocap_core.compare.compare import Technique
from imocap_core.compare.page import technique_page
from imocap_core.compare.words import MotionDifference, markdown_list, technique_findings
from imocap_core.errors import WorkFailed
from imocap_core.figures.style import quiet, save
from imocap_core.io.writers.bvh import write_bvh
from imocap_core.io.writers.motion_clip import MotionClip, bone_tips
from imocap_core.technique.modes import along_mode

SHOWN_MODES = 3


def write_technique(out: Path, t: Technique) -> list[Path]:
    """report.md, joints.csv, performances.csv, mean.bvh and pictures; the report first."""
    each, names = t.instances, t.instances.joint_names
    about = f"{len(each.ids)} performances of {t.action}"
    pictures: dict[str, Figure] = {}
    with quiet():
        pictures["mean.png"] = figures.motion_figure(
            each.ids, each.phase_s, t.mean.joints, each.joints, each.inside,
            "The mean motion", f"{about} on one body, facing one way, at equal phases",
        )  # fmt: skip
        pictures["deviation.png"] = figures.deviation_figure(
            each.phase_s, t.spread_deg, t.spread_mm, names, "How far performances differ",
            f"standard deviation of {about} from their mean",
        )  # fmt: skip
        if t.modes.share.size:
            pictures["modes.png"] = figures.modes_figure(
                each.ids, t.modes.share, t.modes.scores, t.modes.of_joints(), names,
                [_mode_pose(t, k) for k in range(min(SHOWN_MODES, len(t.modes.share)))],
            )  # fmt: skip
        if np.isfinite(t.lead_s).any():
            pictures["timing.png"] = figures.timing_figure(each.ids, each.phase_s, t.lead_s)
        make_folder(out)
        for name, figure in pictures.items():
            save(figure, out / name)
    text.write_course(
        out / "joints.csv", each.phase_s, names,
        {"spread_deg": t.spread_deg, "spread_mm": t.spread_mm},
    )  # fmt: skip
    scores = {f"mode{k + 1}_deg": t.modes.scores[:, k] for k in range(len(t.modes.share))}
    text.write_performances(
        out / "performances.csv", each.ids, {"distance_mm": _from_mean_mm(t), **scores}
    )
    write_bvh(out / "mean.bvh", mean_clip(t))
    angles = technique_angles(t)
    findings = technique_findings(t, angles)
    (out / "report.md").write_text(_report(t, list(pictures), findings), encoding="utf-8")
    (out / "report.html").write_text(technique_page(t, angles, findings), encoding="utf-8")
    names_ = ["report.md", "report.html", "joints.csv", "performances.csv", "mean.bvh", *pictures]
    return [out / name for name in names_]


def mean_clip(t: Technique) -> MotionClip:
    """The mean motion as a joint tree; the pelvis does not move, hands are at rest."""
    shaped: Shaped = t.performances.shaped
    rest, count = shaped.joints_rest.numpy(), len(t.mean.R_local)
    lowest = t.mean.joints[..., 1].min()
    return MotionClip(
        id="mean",
        joint_names=shaped.model.joint_names,
        parents=shaped.model.parents,
        rest=rest - rest[0],
        tips=bone_tips(shaped),
        R_local=in_smpl(t.mean.R_local),
        pelvis=np.tile([0.0, -lowest, 0.0], (count, 1)),
        fps=t.performances.fps,
        frames=np.arange(count, dtype=np.float64),
        inside=np.ones(count, dtype=bool),
        phase_s=t.instances.phase_s,
    )


def _mode_pose(t: Technique, mode: int) -> figures.ModePose:
    """Phase of a mode's largest effect; the body there: mean, one standard deviation up, down."""
    deviation = float(t.modes.deviations()[mode])
    bodies = [
        _placed(t, along_mode(t.mean.R_local, t.modes.shapes[mode], k * deviation))
        for k in (0, 1, -1)
    ]
    most = int(((bodies[1] - bodies[2]) ** 2).sum((1, 2)).argmax())
    return float(t.instances.phase_s[most]), bodies[0][most], bodies[1][most], bodies[2][most]


def _placed(t: Technique, R_local: Float[np.ndarray, "N J 3 3"]) -> Float[np.ndarray, "N J 3"]:
    """Joints (N, J, 3) relative to the pelvis, metres, of rotations (N, J, 3, 3) on one body."""
    count = R_local.shape[1]
    R = torch.as_tensor(in_smpl(R_local))
    body = t.performances.shaped.pose(R, torch.zeros(3, dtype=torch.float64))
    joints = body.joints.numpy()
    return np.asarray((joints - joints[:, :1])[:, :count])


def _from_mean_mm(t: Technique) -> Float[np.ndarray, " M"]:
    """(M,) root mean square distance of a performance from the mean, over joints and moments."""
    squares = (t.mean.shifts**2).sum(-1).mean(-1)
    shown = np.maximum(t.instances.inside.sum(1), 1)
    return np.asarray(1000 * np.sqrt(squares.sum(1) / shown))


def _report(t: Technique, pictures: list[str], findings: list[MotionDifference]) -> str:
    each, names = t.instances, t.instances.joint_names
    several = len(each.ids) > 1
    lines = [
        f"# Technique: {t.action}",
        "",
        f"{len(each.ids)} performances ({', '.join(each.ids)}), {len(each.phase_s)} moments "
        f"from {each.phase_s[0]:.2f} to {each.phase_s[-1]:.2f} s of the reference's time. "
        f"Meaning and limits of the numbers: docs/technique.md.",
        "",
    ]
    if t.performances.left_out:
        lines += [f"Left out: {'; '.join(t.performances.left_out)}.", ""]
    if several:
        from_mean = ", ".join(
            f"{i} {number} mm"
            for i, number in zip(each.ids, map(text.number, _from_mean_mm(t)), strict=True)
        )
        lines += [
            f"**Consistency {text.number(t.whole, 3)}** (1: equal, 0: no more alike than unrelated "
            f"moments). From the mean motion: {from_mean}.",
            "",
            "## Joints",
            "",
            *text.table(
                ["joint", "rotation (deg)", "position (mm)", "consistency"],
                text.joint_rows(names, t.joint_deg, t.joint_mm, t.consistency),
            ),
            "",
            "Standard deviation over the performances, root mean square over the moments. Largest:",
            "",
            *text.moment_sentences(each.phase_s, t.spread_mm, names, "mm"),
            "",
            *markdown_list(findings),
        ]
    titles = {"mean": "Mean motion", "deviation": "Deviation", "modes": "Modes", "timing": "Timing"}
    for picture in pictures:
        title = titles[picture.removesuffix(".png")]
        lines += [f"## {title}", "", f"![{title}]({picture})", ""]
    return "\n".join(lines)


def make_folder(out: Path) -> None:
    """Make the folder; WorkFailed when it cannot be made."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WorkFailed(f"cannot write to {out}: {error.strerror}") from None
