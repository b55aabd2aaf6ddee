"""Figures look the same whatever `matplotlibrc` lies in the working folder."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from imocap_core.figures.overlays import CELL_PX
from imocap_core.figures.page_figures import (
    chosen_trip,
    cycle_figures,
    cycle_frames,
    cycle_starts,
    round_trip,
)
from imocap_core.figures.style import new_figure, quiet, save
from tests.report.made import Made


def picture(file: Path) -> bytes:
    with quiet():
        figure = new_figure(2.0, 1.5)
        axes = figure.add_subplot()
        axes.plot([0, 1], [1, 0])
        axes.set_title("a title")
        save(figure, file)
    return file.read_bytes()


def test_settings_of_others_change_no_figure(tmp_path: Path) -> None:
    theirs = {"axes.facecolor": "red", "lines.linestyle": ":", "text.usetex": True}
    expected = picture(tmp_path / "a.png")
    with mpl.rc_context(theirs):  # type: ignore[arg-type]
        assert picture(tmp_path / "b.png") == expected
        assert {name: mpl.rcParams[name] for name in theirs} == theirs


def test_the_style_ends_with_an_error(tmp_path: Path) -> None:
    before = dict(mpl.rcParams)
    with pytest.raises(ZeroDivisionError), quiet():
        assert 1 / (mpl.rcParams["font.size"] == 0)
    assert dict(mpl.rcParams) == before


def test_a_figure_is_as_matplotlib_lays_it_out(tmp_path: Path) -> None:
    laid_out = picture(tmp_path / "a.png")
    with quiet():
        figure = new_figure(2.0, 1.5)
        axes = figure.add_subplot()
        axes.plot([0, 1], [1, 0])
        axes.set_title("a title")
        figure.savefig(tmp_path / "b.png", dpi=figure.dpi, metadata={"Software": None})
    assert laid_out == (tmp_path / "b.png").read_bytes()


def test_consistent_maps_lead_home_and_inconsistent_ones_do_not() -> None:
    lengths = {"a": 5, "b": 6, "c": 7}

    def nearest(here: str, there: str) -> np.ndarray:
        return np.minimum(np.arange(lengths[here]), lengths[there] - 1)

    trip = round_trip(nearest, ["a", "b", "c"])
    assert [len(positions) for positions in trip] == [5] * 4
    np.testing.assert_array_equal(trip[-1], trip[0])
    late = {"a": 0, "b": 2, "c": 0}  # frames by which the map from a video is wrong
    back = round_trip(lambda a, b: np.minimum(nearest(a, b) + late[a], lengths[b] - 1), "abc")[-1]
    np.testing.assert_array_equal(back[:3], [2, 3, 4])


def test_the_trip_leaves_out_what_is_excluded_and_prefers_central_videos() -> None:
    made = Made(count=4, frames=8)
    assert chosen_trip(made.refined.sync) == ["v1", "v2", "v3"]
    without = made.refined.sync.model_copy(update={"excluded": ["v2"]})
    assert chosen_trip(without) == ["v1", "v3", "v4"]
    assert chosen_trip(Made(count=2).refined.sync) == ["v1", "v2"]


def test_the_figure_shows_what_it_asked_for(made: Made) -> None:
    sync = made.refined.sync
    trip = chosen_trip(sync)
    starts = cycle_starts(sync, trip)
    assert starts == sorted(set(starts))
    assert starts[0] >= 4  # v3 begins there
    wanted = cycle_frames(sync, trip, starts)
    assert set(starts) <= wanted["v1"]
    cell = np.zeros((CELL_PX[1], CELL_PX[0], 3), np.uint8)
    cells = {video: dict.fromkeys(indices, cell) for video, indices in wanted.items()}
    frames = dict(zip(made.ids, made.frames, strict=True))
    with quiet():
        sheet, figure = cycle_figures(sync, trip, starts, cells, frames)
    assert [len(line.get_xdata()) for line in figure.axes[0].lines[:2]] == [len(made.frames[0])] * 2
    texts = [text.get_text() for text in sheet.texts]
    assert f"{starts[0]} and back" in texts
    assert "back in v1" in texts
