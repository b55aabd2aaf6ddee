"""The observability report in sentences: similar views, missing views, uncertain joints."""

from __future__ import annotations

from pathlib import Path

from imocap_core.artifacts.schemas import NearPair, SyncSummary, Table, Uncertainty, WeakSpan
from imocap_core.verdict.findings import listed
from imocap_core.verdict.further_view import further_view

FILE = "observability.md"
SHOWN = 8  # spans listed on the report's page; observability.md lists all


def sentences(claimed: Uncertainty, sync: SyncSummary, most: int | None = SHOWN) -> list[str]:
    """Near-identical viewpoints, the most useful further viewpoint, and ill-determined spans.

    most: maximum number of spans, None for all.
    """
    lines = [_near(pair) for pair in claimed.near]
    lines += _further(claimed, sync)
    weak = claimed.weak if most is None else claimed.weak[:most]
    lines += [_weak(span) for span in weak]
    if len(weak) < len(claimed.weak):
        lines.append(f"observability.md lists {len(claimed.weak) - len(weak)} more spans.")
    if not claimed.weak:
        lines.append(
            f"No joint's standard deviation stays above {claimed.weak_limit:g} times the action's "
            f"median of {claimed.median_mm:.0f} mm."
        )
    return lines


def observability_table(claimed: Uncertainty, sync: SyncSummary) -> Table:
    """The sentences as a table of the report."""
    return Table(
        name="open",
        title="Observability",
        columns=["sentence"],
        rows=[[sentence] for sentence in sentences(claimed, sync)],
    )


def observability_markdown(title: str, claimed: Uncertainty, sync: SyncSummary) -> str:
    """The whole observability report as a page."""
    lines = "\n".join(f"* {sentence}" for sentence in sentences(claimed, sync, most=None))
    return f"# {title}: observability\n\n{claimed.status}\n\n{lines}\n"


def write_observability(folder: Path, title: str, claimed: Uncertainty, sync: SyncSummary) -> str:
    """Write the whole observability report into a folder; returns its file name."""
    text = observability_markdown(title, claimed, sync)
    (folder / FILE).write_text(text, encoding="utf-8")
    return FILE


def _near(pair: NearPair) -> str:
    a, b = pair.videos
    depth = "the other videos" if pair.seen_across else "priors"
    return (
        f"{a} and {b} show the performer from nearly the same side ({pair.angle_deg:.0f} degrees "
        f"apart): depth along their line of sight depends on {depth}."
    )


def _further(claimed: Uncertainty, sync: SyncSummary) -> list[str]:
    """The most useful further viewpoint, or why none is named."""
    clause = further_view(claimed, sync)
    if clause:
        return [f"{clause[0].upper()}{clause[1:]}."]
    treated = [i for i in sync.ids if i in {*sync.excluded, *sync.mirrored}]
    if not treated or not claimed.viewpoints:
        return []
    return [
        f"No side is suggested for one more camera: {listed(treated)} may show what is missing "
        "(left out, or treated as mirrored)."
    ]


def _weak(span: WeakSpan) -> str:
    joint = span.joint.replace("_", " ")
    return (
        f"{span.video}: {joint} from {span.begin_s:.1f} to {span.end_s:.1f} s (frames "
        f"{span.first_frame} to {span.last_frame}): {span.sigma_mm:.0f} mm, {span.of_median:.1f} "
        "times the action's median."
    )
