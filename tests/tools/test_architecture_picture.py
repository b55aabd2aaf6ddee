"""The picture of the architecture shows the stages and rooms of the code, in a true order."""

import re
import tomllib
from itertools import chain

import grimp
import pytest

from tools import make_architecture_picture as tool
from tools.make_architecture_picture import ROOT, TARGET, RoomBox, StageBox, names_in

ADVICE = "run: python -m tools.make_architecture_picture"


@pytest.fixture(scope="module")
def bands() -> list[list[RoomBox]]:
    return tool.rooms_of_code()


@pytest.fixture(scope="module")
def stages() -> list[StageBox]:
    return tool.stages_of_code()


def lines_in(drawing: str) -> int:
    (total,) = re.findall(r"lines of Python, ([\d,]+) in all", drawing)
    return int(total.replace(",", ""))


def test_the_committed_picture_shows_the_code(stages, bands):
    committed = TARGET.read_text(encoding="utf-8")
    assert names_in(committed, "stage") == [stage.name for stage in stages], ADVICE
    assert names_in(committed, "artifact") == [stage.artifact for stage in stages], ADVICE
    assert names_in(committed, "room") == [room.name for room in chain(*bands)], ADVICE
    total = sum(room.lines for room in chain(*bands))
    assert lines_in(committed) == pytest.approx(total, rel=0.1), ADVICE


def test_the_same_code_gives_the_same_bytes(stages, bands):
    drawing = tool.picture(stages, bands)
    assert drawing == tool.picture(tool.stages_of_code(), tool.rooms_of_code())


def test_the_page_says_the_way_from_a_stage_to_the_residual_as_the_code_calls() -> None:
    page = tool.PAGE.read_text(encoding="utf-8")
    assert tool.chain_of_code() in page, ADVICE
    assert tool.page_with_chain(page) == page
    assert len(tool.CHAIN) == 5


def test_a_way_that_the_code_does_not_call_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tool, "CHAIN", (*tool.CHAIN[:2], tool.CHAIN[4], tool.CHAIN[3]))
    with pytest.raises(ValueError, match="does not lead to add_to"):
        tool.chain_of_code()


def test_every_import_leads_to_a_later_room(bands: list[list[RoomBox]]) -> None:
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    order = {room.name: place for place, room in enumerate(chain(*bands))}
    graph = grimp.build_graph(*contract["root_packages"], cache_dir=None)
    rooms = {m: m.removeprefix("imocap_core.").split(".")[0] for m in graph.modules}
    wrong = {
        f"{rooms[module]} imports {rooms[other]}"
        for module in graph.modules
        for other in graph.find_modules_directly_imported_by(module)
        if order.get(rooms[module], 0) > order.get(rooms[other], len(order))
    }
    assert wrong == set()
