"""What the videos leave open, in sentences."""

from __future__ import annotations

from imocap_core.artifacts.schemas import NearPair, Table, Uncertainty, WeakSpan

SHOWN = 8  # spans named on the report's page; observability.md has them all
STANDS_OUT = 1.5  # the best side helps this many times as much as the worst
SIDES = (
    *("in front", "front left", "left", "back left"),
    *("behind", "back right", "right", "front right"),
)  # every 45 degrees


def sentences(claimed: Uncertainty, most: int | None = SHOWN) -> list[str]:
    """Near-identical viewpoints, the viewpoint that would help most, and ill-determined spans.

    ``most``: spans named at most, None for all.
    """
    said = [_near(pair) for pair in claimed.near]
    said += _further(claimed)
    weak = claimed.weak if most is None else claimed.weak[:most]
    said += [_weak(span) for span in weak]
    if len(weak) < len(claimed.weak):
        said.append(f"{len(claimed.weak) - len(weak)} more spans are in observability.md.")
    if not claimed.weak:
        said.append(
            f"No joint's standard deviation stays above {claimed.weak_limit:g} times the action's "
            f"median of {claimed.median_mm:.0f} mm."
        )
    return said


def open_table(claimed: Uncertainty) -> Table:
    """The sentences as a table of the report."""
    return Table(
        name="open",
        title="What the videos leave open",
        columns=["sentence"],
        rows=[[said] for said in sentences(claimed)],
    )


def observability_markdown(title: str, claimed: Uncertainty) -> str:
    """The whole report as a page."""
    lines = "\n".join(f"* {said}" for said in sentences(claimed, most=None))
    return f"# {title}: what the videos leave open\n\n{claimed.status}\n\n{lines}\n"


def side_of(azimuth_deg: float) -> str:
    """A camera's side in words, from the performer's point of view."""
    return SIDES[round(azimuth_deg / 45) % len(SIDES)]


def _near(pair: NearPair) -> str:
    a, b = pair.videos
    depth = "the other videos" if pair.seen_across else "priors"
    return (
        f"{a} and {b} see the performer from nearly the same side ({pair.angle_deg:.0f} degrees "
        f"apart): depth along it rests on {depth}."
    )


def _further(claimed: Uncertainty) -> list[str]:
    if not claimed.viewpoints:
        return []
    best = max(claimed.viewpoints, key=lambda v: v.reduction)
    least = min(v.reduction for v in claimed.viewpoints)
    if best.reduction < STANDS_OUT * least:
        return [
            "No side is missing: one more camera would lower the summed variance of the common "
            f"motion by {least:.0%} to {best.reduction:.0%}, wherever it stood."
        ]
    if claimed.azimuth_from == "performer":
        side = side_of(best.azimuth_deg)
        place = f"at {best.azimuth_deg:.0f} degrees ({side}, as the performer sees it)"
    else:
        place = f"{best.azimuth_deg:.0f} degrees round the performer from the reference camera"
    return [
        f"One more camera would help most {place}: the summed variance of the common motion would "
        f"fall by {best.reduction:.0%}."
    ]


def _weak(span: WeakSpan) -> str:
    joint = span.joint.replace("_", " ")
    return (
        f"{span.video}: {joint} from {span.begin_s:.1f} to {span.end_s:.1f} s (frames "
        f"{span.first_frame} to {span.last_frame}): {span.sigma_mm:.0f} mm, {span.of_median:.1f} "
        "times the action's median."
    )
