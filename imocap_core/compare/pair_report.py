"""The files of a report on two performers: Markdown, a table, pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from imocap_core.compare import figures, text
from imocap_core.compare.angles import pair_angles
from imocap_core.compare.compare import TechniquePair
from imocap_core.compare.page import pair_page
from imocap_core.compare.report import make_folder
from imocap_core.compare.words import MotionDifference, markdown_list, pair_findings
from imocap_core.figures.style import quiet, save
from imocap_core.technique.mean_motion import over_moments


def write_pair(out: Path, pair: TechniquePair) -> list[Path]:
    """report.md, joints.csv and pictures of two performers; the report first."""
    first, second = pair.first.action, pair.second.action
    names, ids = pair.first.instances.joint_names, (first, second)
    both = np.stack(pair.joints)
    with quiet():
        motion = figures.motion_figure(
            ids, pair.phase_s, None, both, np.ones(both.shape[:2], dtype=bool),
            "Two performers", f"mean motions of {first} and {second} at {first}'s phases, "
            f"on one body, facing one way",
        )  # fmt: skip
        heat = figures.deviation_figure(
            pair.phase_s, pair.difference.angle_deg, pair.difference.distance_mm, names,
            "Where they differ", f"between the mean motions of {first} and {second}",
        )  # fmt: skip
        make_folder(out)
        save(motion, out / "motions.png")
        save(heat, out / "difference.png")
    text.write_course(
        out / "joints.csv", pair.phase_s, names,
        {
            "angle_deg": pair.difference.angle_deg,
            "distance_mm": pair.difference.distance_mm,
            "times_spread": pair.difference.ratio,
            "second_phase_s": np.repeat(pair.second_s[:, None], len(names), axis=1),
        },
    )  # fmt: skip
    angles = pair_angles(pair)
    findings = pair_findings(pair, angles)
    (out / "report.md").write_text(_pair_report(pair, findings), encoding="utf-8")
    (out / "report.html").write_text(pair_page(pair, angles, findings), encoding="utf-8")
    names_ = ("report.md", "report.html", "joints.csv", "motions.png", "difference.png")
    return [out / name for name in names_]


def _pair_report(pair: TechniquePair, findings: list[MotionDifference]) -> str:
    first, second = pair.first.action, pair.second.action
    names, between = pair.first.instances.joint_names, pair.difference
    deg, mm, ratio = map(over_moments, (between.angle_deg, between.distance_mm, between.ratio))
    order = np.argsort(-mm, kind="stable")
    return "\n".join(
        [
            f"# Technique: {first} and {second}",
            "",
            f"Mean of {len(pair.first.instances.ids)} performances of {first}, mean of "
            f"{len(pair.second.instances.ids)} of {second}. They share {len(pair.phase_s)} of "
            f"{len(pair.first.instances.phase_s)} moments of {first}'s time axis, "
            f"{pair.phase_s[0]:.2f} to {pair.phase_s[-1]:.2f} s; {second}'s "
            f"phases "
            f"{pair.second_s[0]:.2f} to {pair.second_s[-1]:.2f} s. One body, facing one way.",
            "",
            *markdown_list(findings),
            *text.table(
                ["joint", "rotation (deg)", "position (mm)", "times the spread"],
                [
                    (
                        figures.in_words(names[j]),
                        text.number(deg[j]),
                        text.number(mm[j]),
                        text.number(ratio[j]),
                    )
                    for j in order
                ],
            ),
            "",
            "Root mean square over the moments. *Times the spread*: of the position, in standard "
            "deviations of each performer's repetitions. Largest:",
            "",
            *text.moment_sentences(pair.phase_s, between.distance_mm, names, "mm"),
            "",
            "![Two performers](motions.png)",
            "",
            "![Where they differ](difference.png)",
            "",
        ]
    )
