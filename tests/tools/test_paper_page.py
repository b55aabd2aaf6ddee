"""docs/paper.md: every function, stage, test, parameter and file that it names exists."""

import importlib
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from imocap_core.params import Params
from imocap_core.pipeline.graph import read_pipeline, settings

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
STAGES = yaml.safe_load((ROOT / "pipeline.yaml").read_text(encoding="utf-8"))["stages"]
JOINT_SOLVE = "imocap_core.motion.multiview.smpl_ba.recover_motion"
# Of Python or of files: dotted names that the page may use besides functions and parameters.
DOTTED = re.compile(r"`([a-z]\w*(?:\.\w+)+)`")
FILES = re.compile(r"`((?:tools|tests|stages|benchmarks|imocap_core)/[\w/.]+)`")


def rows() -> list[list[str]]:
    """The cells of the table's rows."""
    lines = [line for line in PAGE.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines[1:]]


def named(path: str) -> Any:
    """What a dotted path in imocap_core names; LookupError when there is no such thing."""
    words = path.removeprefix("imocap_core.").split(".")
    for cut in range(len(words), 0, -1):
        module = ".".join(["imocap_core", *words[:cut]])
        try:
            thing: Any = importlib.import_module(module)
        except ModuleNotFoundError:
            continue
        for word in words[cut:]:
            if not hasattr(thing, word):
                raise LookupError(f"{path}: {module} has no {word}")
            thing = getattr(thing, word)
        return thing
    raise LookupError(f"{path}: no such module")


def check_parameter(text: str) -> None:
    """`group.name`, `group.*`, or `group.name: value`; LookupError when it is none."""
    name, _, value = text.partition(": ")
    group, _, field = name.partition(".")
    fields = getattr(Params(), group, None)
    if fields is None or (field != "*" and not hasattr(fields, field)):
        raise LookupError(f"{name}: no such parameter")
    if value:
        pipeline = read_pipeline(ROOT / "pipeline.yaml")
        settings(pipeline, {group: {field: yaml.safe_load(value)}}, Path("docs/paper.md"), [])


def check_row(functions: str, stages: str, tests: str, parameters: str) -> None:
    """LookupError for the first thing in a row of the table that does not exist."""
    module = ""
    for path in re.findall(r"`([^`]+)`", functions):
        full = path if "." in path else f"{module}.{path}"
        named(full)
        module = full.rpartition(".")[0]
    for stage in stages.split(", "):
        if stage not in STAGES:
            raise LookupError(f"{stage}: no such stage")
    folder = ROOT
    for test in tests.split(", "):
        file = ROOT / test if "/" in test else folder / test
        if not file.exists():
            raise LookupError(f"{test}: no such test")
        folder = file.parent
    for text in re.findall(r"`([^`]+)`", parameters):
        check_parameter(text)


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_everything_in_a_row_exists(row: list[str]) -> None:
    assert len(row) == 5, f"docs/paper.md: expected 5 cells, got {row}"
    try:
        check_row(*row[1:])
    except LookupError as error:
        pytest.fail(f"docs/paper.md, row {row[0]!r}: {error}")


def test_the_table_names_the_entry_of_the_joint_solve() -> None:
    assert any(f"`{JOINT_SOLVE}`" in row[1] for row in rows())


@pytest.mark.parametrize("name", sorted(set(DOTTED.findall(PAGE))))
def test_every_dotted_name_on_the_page_exists(name: str) -> None:
    group = name.partition(".")[0]
    if hasattr(Params(), group):
        try:
            check_parameter(name)
        except LookupError:
            named(name)
    else:
        named(name)


@pytest.mark.parametrize("file", sorted(set(FILES.findall(PAGE))))
def test_every_file_on_the_page_exists(file: str) -> None:
    assert (ROOT / file).exists()


def test_what_does_not_exist_is_noticed() -> None:
    with pytest.raises(LookupError, match=r"affinity has no gone"):
        check_row("`sync.affinity.gone`", "sync", "tests/sync/test_affinity.py", "–")
    with pytest.raises(LookupError, match="no such stage"):
        check_row("`sync.warp.dtw.dtw`", "synchronise", "tests/sync/test_dtw.py", "–")
    with pytest.raises(LookupError, match="no such test"):
        check_row("`sync.warp.dtw.dtw`", "sync", "tests/sync/test_dtw.py, test_gone.py", "–")
    with pytest.raises(LookupError, match="no such parameter"):
        check_row("`sync.warp.dtw.dtw`", "sync", "tests/sync/test_dtw.py", "`sync.gone`")
