"""Screening before the synchronisation: mirrored videos, and videos of another action."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from imocap_core.params import SyncParams
from imocap_core.sync.evidence import SyncEvidence
from imocap_core.sync.procrustes import centred
from imocap_core.sync.screening.decisions import LARGEST_SCORE, decide_by_keypoints
from imocap_core.sync.screening.explanation import prepared
from imocap_core.sync.screening.registration import Keypoints2D

RATE_PER_S = 15.0  # estimates err for about a quarter of a second: more frames tell little more


@dataclass(frozen=True)
class Screening:
    """Mirrored videos, videos of another action, and what is done about them (video indices).

    Attributes:
        outliers: detected.
        mirrored: detected or declared.
        excluded: left out of the joint synchronisation and reconstruction.
        flipped: treated as their mirror image.
        outlier_score, mirror_margin: see `outliers` and `mirror`; NaN where not computed.
        undecided: look like another action, but it is not clear; they take part.
        symmetric: the action is nearly its own mirror image: no video can be called mirrored.
        unfit: outliers whose detections fit no body.
    """

    outliers: tuple[int, ...]
    mirrored: tuple[int, ...]
    excluded: tuple[int, ...]
    flipped: tuple[int, ...]
    outlier_score: Float[np.ndarray, " M"]
    mirror_margin: Float[np.ndarray, " M"]
    undecided: tuple[int, ...] = ()
    symmetric: bool = False
    unfit: tuple[int, ...] = ()


def not_screened(count: int, flipped: Sequence[int] = ()) -> Screening:
    """The screening of videos that were not examined."""
    unknown = np.full(count, np.nan)
    return Screening((), tuple(flipped), (), tuple(flipped), unknown, unknown.copy())


def screen(evidence: SyncEvidence, rates: Float[np.ndarray, " M"], params: SyncParams) -> Screening:
    """Detect mirrored videos, then, with those reflected, videos of another action.

    The keypoints decide, held against the others' common motion (`decisions`), because poses may
    come of a monocular fit that went wrong; where there are none, pictures of the poses do. The
    reference is no outlier; without the joints' twins no video is called mirrored.

    Args:
        rates: seconds of the action per second of each video.

    Raises:
        ValueError: a video is declared mirrored, without twins.
    """
    twins, declared = evidence.twins, evidence.mirrored or [None] * len(rates)
    look_outliers = params.outliers != "ignore"
    look_mirrored = twins is not None and params.mirrored != "ignore"
    M = len(rates)
    declared_mirrored = [v for v in range(M) if declared[v]]
    if declared_mirrored and twins is None:
        raise ValueError(
            "mirrored: a video is declared mirrored, but the joints' twins are unknown"
        )
    if M < 2 or not (look_outliers or look_mirrored):
        return not_screened(M, declared_mirrored)
    unfit = [v for v in evidence.unfit if look_outliers and v != evidence.reference]
    stride = [max(1, round(f / r / RATE_PER_S)) for f, r in zip(evidence.fps, rates, strict=True)]
    poses, keypoints = evidence.scaled[0], evidence.keypoints
    if keypoints is None:
        poses, keypoints = _pictures(*evidence.scaled)
    thin = [x[::n] for x, n in zip(poses, stride, strict=True)]
    films = [
        Keypoints2D(k.xy_px[::n], k.weight[::n]) for k, n in zip(keypoints, stride, strict=True)
    ]
    videos, paired = prepared(thin, films, twins or range(poses[0].shape[1]))
    upright = [v.mirrored(paired) if d else v for v, d in zip(videos, declared, strict=True)]
    decided = decide_by_keypoints(
        upright, paired, [d is not None for d in declared], np.arange(M) == evidence.reference,
        unfit, look_mirrored=look_mirrored, look_outliers=look_outliers,
    )  # fmt: skip
    flips = decided.mirrored if params.mirrored == "flip" else ()
    return Screening(
        outliers=decided.outliers,
        mirrored=tuple(sorted({*decided.mirrored, *declared_mirrored})),
        excluded=decided.outliers if params.outliers == "exclude" else (),
        flipped=tuple(sorted({*flips, *declared_mirrored})),
        outlier_score=decided.score,
        mirror_margin=decided.margin,
        undecided=decided.undecided,
        symmetric=decided.symmetric,
        unfit=tuple(unfit),
    )


def _pictures(
    poses: Sequence[Float[np.ndarray, "_T J 3"]], weights: Sequence[Float[np.ndarray, "_T J"]]
) -> tuple[list[Float[np.ndarray, "_T J 3"]], list[Keypoints2D]]:
    """Poses, the axis along which they are tallest as the second, and as a distant camera on the
    third shows them."""
    spread = [
        np.einsum("tj,tjk->k", w, centred(x, w) ** 2) for x, w in zip(poses, weights, strict=True)
    ]
    turned = [np.roll(x, 1 - int(np.sum(spread, axis=0).argmax()), axis=-1) for x in poses]
    return turned, [Keypoints2D(x[..., :2], w) for x, w in zip(turned, weights, strict=True)]


ANOTHER_ACTION = "seems to show another action"
NO_BODY = "has detections that fit no body"
WEAKLY_ALIKE = "resembles the others only weakly"
REFLECTED = "fits the others"
TWO_ARE_LEFT = "only two videos are left"


def sentences(screening: Screening, names: Sequence[str]) -> list[str]:
    """One sentence per video that is an outlier or mirrored; `names` of the videos."""
    messages = [_outlier(screening, v, names[v]) for v in screening.outliers]
    messages += [_mirrored(screening, v, names[v]) for v in screening.mirrored]
    messages += [f"{names[v]} {WEAKLY_ALIKE}: it takes part" for v in screening.undecided]
    if screening.symmetric:
        messages.append(
            "these videos do not show whether one of them is mirrored (some actions are their own "
            "mirror image): none is flipped; mirrored: true in action.yaml flips one"
        )
    left = len(names) - len(screening.excluded)
    if screening.excluded and left == 2:
        messages.append(
            f"{TWO_ARE_LEFT}, and with two it cannot be decided which shows another "
            "action; check the excluded ones, or set sync.outliers: report"
        )
    return messages


def corrected(
    before: Sequence[str],
    after: Sequence[str],
    *,
    changed: Collection[str],
    returned: Sequence[str],
    straight: Sequence[str],
) -> list[str]:
    """Sentences of a first screening, with those of videos that a second one decides otherwise
    replaced.

    Args:
        before, after: of the first, of the second. changed: the videos, by name; returned: those
            that take part again; straight: those that are no longer taken to be mirrored.
    """
    outdated = tuple(
        f"{video} {reason}"
        for video in sorted(changed)
        for reason in (ANOTHER_ACTION, WEAKLY_ALIKE, REFLECTED)
    )
    outdated += (TWO_ARE_LEFT,)
    seemed = {
        "show another action, but the joint motion of the others explains it: it takes part": (
            returned
        ),
        "be mirrored, but the joint motion of the others explains it as it was filmed": straight,
    }
    return [
        *(note for note in before if not note.startswith(outdated)),
        *(f"{video} at first seemed to {what}" for what, of in seemed.items() for video in of),
        *(note for note in after if note.startswith(outdated)),
    ]


def _outlier(screening: Screening, v: int, name: str) -> str:
    done = (
        "left out, its frames unmatched (sync.outliers: exclude)"
        if v in screening.excluded
        else "used nevertheless (sync.outliers: report)"
    )
    if v in screening.unfit:
        return f"{name} {NO_BODY}: {done}"
    return (
        f"{name} {ANOTHER_ACTION}: the other videos explain each other and not it "
        f"(score {screening.outlier_score[v]:.2f}, above {LARGEST_SCORE:.1f} is another "
        f"action): {done}"
    )


def _mirrored(screening: Screening, v: int, name: str) -> str:
    margin = screening.mirror_margin[v]
    why = (
        f"{REFLECTED} {100 * (np.exp(margin) - 1):.0f} % better reflected"
        if np.isfinite(margin) and margin > 0
        else "is declared mirrored"
    )
    done = (
        "treated as its mirror image"
        if v in screening.flipped
        else "left as it is (mirrored: true in action.yaml flips it)"
    )
    return f"{name} {why}: {done}"
