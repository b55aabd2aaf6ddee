"""The observability report in sentences: similar views, missing views, uncertain joints."""

from __future__ import annotations

from pathlib import Path

from imocap_core.artifacts.schemas import NearPair, Table, Uncertainty, WeakSpan

FILE = "observability.md"
SHOWN = 8  # spans listed on the report's page; observability.md lists all
MIN_BENEFIT_RATIO = 1.5  # of the best side for one more camera to the worst, to name a side
SIDES = (
    *("in front", "front left", "left", "back left"),
    *("behind", "back right", "right", "front right"),
)  # every 45 degrees


def sentences(claimed: Uncertainty, most: int | None = SHOWN) -> list[str]:
    """Near-identical viewpoints, the most useful further viewpoint, and ill-determined spans.

    most: maximum number of spans, None for all.
    """
    lines = [_near(pair) for pair in claimed.near]
    lines += _further(claimed)
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


def observability_table(claimed: Uncertainty) -> Table:
    """The sentences as a table of the report."""
    return Table(
        name="open",
        title="Observability",
        columns=["sentence"],
        rows=[[sentence] for sentence in sentences(claimed)],
    )


def observability_markdown(title: str, claimed: Uncertainty) -> str:
    """The whole observability report as a page."""
    lines = "\n".join(f"* {sentence}" for sentence in sentences(claimed, most=None))
    return f"# {title}: observability\n\n{claimed.status}\n\n{lines}\n"


def write_observability(folder: Path, title: str, claimed: Uncertainty) -> str:
    """Write the whole observability report into a folder; returns its file name."""
    (folder / FILE).write_text(observability_markdown(title, claimed), encoding="utf-8")
    return FILE


def side_of(azimuth_deg: float) -> str:
    """Name of a camera's side, from the performer's point of view."""
    return SIDES[round(azimuth_deg / 45) % len(SIDES)]


def _near(pair: NearPair) -> str:
    a, b = pair.videos
    depth = "the other videos" if pair.seen_across else "priors"
    return (
        f"{a} and {b} show the performer from nearly the same side ({pair.angle_deg:.0f} degrees "
        f"apart): depth along their line of sight depends on {depth}."
    )


def _further(claimed: Uncertainty) -> list[str]:
    if not claimed.viewpoints:
        return []
    best = max(claimed.viewpoints, key=lambda v: v.reduction)
    least = min(v.reduction for v in claimed.viewpoints)
    if best.reduction < MIN_BENEFIT_RATIO * least:
        return [
            "One more camera would help about equally from every side: it would lower the summed "
            f"variance of the common motion by {least:.0%} to {best.reduction:.0%}."
        ]
    if claimed.azimuth_from == "performer":
        side = side_of(best.azimuth_deg)
        place = f"at {best.azimuth_deg:.0f} degrees ({side} of the performer)"
    else:
        place = f"at {best.azimuth_deg:.0f} degrees around the performer from the reference camera"
    return [
        f"One more camera would help most {place}: it would lower the summed variance of the "
        f"common motion by {best.reduction:.0%}."
    ]


def _weak(span: WeakSpan) -> str:
    joint = span.joint.replace("_", " ")
    return (
        f"{span.video}: {joint} from {span.begin_s:.1f} to {span.end_s:.1f} s (frames "
        f"{span.first_frame} to {span.last_frame}): {span.sigma_mm:.0f} mm, {span.of_median:.1f} "
        "times the action's median."
    )
