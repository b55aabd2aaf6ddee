"""Boxes in which nobody new was found: for some time they are not looked at again."""

from __future__ import annotations

from .boxes import PersonBox, overlap

PATIENCE = 30  # frames
SAME_BOX = 0.5  # intersection over union


class RefusedBoxes:
    """Boxes with nobody new in them, and when that was found."""

    def __init__(self) -> None:
        self._boxes: list[tuple[int, PersonBox]] = []

    def add(self, frame: int, box: PersonBox) -> None:
        """Nobody new is in a box of this frame."""
        self._boxes = [(t, other) for t, other in self._boxes if frame - t < PATIENCE]
        self._boxes.append((frame, box))

    def has(self, frame: int, box: PersonBox) -> bool:
        """Whether nobody new was in a box a short time before this frame."""
        return any(
            frame - t < PATIENCE and overlap(box.corners, other.corners) > SAME_BOX
            for t, other in self._boxes
        )

    def forget(self) -> None:
        """Somebody was lost, and may be in any of them."""
        self._boxes = []
