"""Loop and foot lock of an export, and what is said about them."""

from __future__ import annotations

from collections.abc import Mapping

from imocap_core.export.options import ExportOptions
from imocap_core.result.cleaned import FootLock, loop, with_locked_feet
from imocap_core.result.result import ActionResult


def cleaned(
    result: ActionResult, options: ExportOptions
) -> tuple[ActionResult, dict[str, FootLock]]:
    """The result looped and with locked feet, as the options say; what the lock changed."""
    if options.loop is not None:
        result = loop(result, in_place=options.loop == "in-place")
    if not options.lock_feet:
        return result, {}
    return with_locked_feet(result, loops=options.loop is not None)


def foot_lock_notes(locks: Mapping[str, FootLock]) -> list[str]:
    """A sentence for each video."""
    return [_sentence(video, lock) for video, lock in locks.items()]


def _sentence(video: str, lock: FootLock) -> str:
    if lock.contact_pct == 0:
        return f"{video}: no foot stands on the ground, nothing was locked"
    short = f"; in {lock.short} frames a leg is too short for it" if lock.short else ""
    return (
        f"{video}: feet in contact ({lock.contact_pct:.0f} % of the time) moved {lock.slid_mm:.1f} "
        f"mm a frame, now {lock.slides_mm:.1f}; joints changed by {lock.moved_mm:.1f} mm on "
        f"average, {lock.most_mm:.0f} at most{short}"
    )
