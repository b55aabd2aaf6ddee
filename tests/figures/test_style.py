"""Figures look the same whatever `matplotlibrc` lies in the working folder."""

from pathlib import Path

import matplotlib as mpl
import pytest

from imocap_core.figures.style import new_figure, quiet, save


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
