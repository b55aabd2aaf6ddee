"""The report's table of what was looked at again."""

import numpy as np

from imocap_core.artifacts.schemas import Redetect, RedetectedVideo
from imocap_core.report.table_files import GLOSSARY, column_title
from imocap_core.report.tables import second_look_tables


def test_each_video_says_what_was_asked_and_what_moved() -> None:
    video = RedetectedVideo(
        id="v2",
        looked_at=np.array([3, 4, 9]),
        contradicted=5,
        frame=np.array([3, 3, 9]),
        point=np.array([15, 17, 27]),
        xy_px=np.zeros((3, 2)),
        xy_first_px=np.zeros((3, 2)),
        confidence=np.array([0.5, 0.0, 0.7]),
    )
    (table,) = second_look_tables(Redetect(videos=[video], note=""))
    assert table.rows == [["v2", 3, 5, 2]]
    titles = [column_title(name) for name in table.columns]
    assert titles == ["video", "pictures looked at again", "joints contradicted", "joints moved"]
    assert set(table.columns[1:]) <= set(GLOSSARY)
    assert second_look_tables(Redetect(videos=[], note="nothing to look at")) == []
