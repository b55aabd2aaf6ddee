"""The picture of the architecture shows the stages and rooms of the code, in a true order."""

import re
import tomllib
from itertools import chain, pairwise

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


def test_the_committed_picture_shows_the_code(
    stages: list[StageBox], bands: list[list[RoomBox]]
) -> None:
    committed = TARGET.read_text(encoding="utf-8")
    assert names_in(committed, "stage") == [stage.name for stage in stages], ADVICE
    assert names_in(committed, "artifact") == [stage.artifact for stage in stages], ADVICE
    assert names_in(committed, "room") == [room.name for room in chain(*bands)], ADVICE
    total = sum(room.lines for room in chain(*bands))
    assert lines_in(committed) == pytest.approx(total, rel=0.1), ADVICE


def test_the_same_code_gives_the_same_bytes(
    stages: list[StageBox], bands: list[list[RoomBox]]
) -> None:
    drawing = tool.picture(stages, bands)
    assert drawing == tool.picture(tool.stages_of_code(), tool.rooms_of_code())


def test_the_files_from_a_stage_to_a_residual_import_each_other() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    files = re.findall(r"^\d\. `([\w/]+)\.py`", page, flags=re.M)
    graph = grimp.build_graph("imocap_core", "stages", cache_dir=None)
    modules = [file.replace("/", ".") for file in files]
    assert len(modules) == 4
    for module, imported in pairwise(modules):
        packages = {imported, imported.rpartition(".")[0]}  # or by way of the package's names
        assert packages & graph.find_modules_directly_imported_by(module), (module, imported)


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
