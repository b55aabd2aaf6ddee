"""What the second look at the pictures was asked, and what it changed."""

from __future__ import annotations

from imocap_core.artifacts.schemas import Redetect, Table
from imocap_core.artifacts.schemas.evaluate import Cell


def second_look_tables(again: Redetect) -> list[Table]:
    """One table, or none where no picture was looked at again."""
    rows: list[list[Cell]] = [
        [
            video.id,
            len(video.looked_at),
            video.contradicted,
            int((video.confidence > 0).sum()),
        ]
        for video in again.videos
    ]
    if not rows:
        return []
    return [
        Table(
            name="second_look",
            title="Pictures that were looked at again",
            columns=["video", "pictures_again", "contradicted", "moved_joints"],
            rows=rows,
            note="Limb joints that the detector doubted and the other videos have elsewhere. One "
            "moves where the picture shows a joint near the expected place; the others stay, as "
            "performances may differ.",
        )
    ]
