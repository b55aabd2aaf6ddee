"""Every parameter has its default, unit, bounds and description in one place."""

import ast
import json
from pathlib import Path

import pytest

from imocap_core.library.status import Parameter, parameter_table
from imocap_core.params import Params
from imocap_core.pipeline.graph import read_pipeline, settings
from tools import make_parameter_docs as tool

ROOT = Path(__file__).resolve().parents[1]
ENDINGS = {
    "_s": "s",
    "_m": "m",
    "_mm": "mm",
    "_px": "px",
    "_rad": "rad",
    "_deg": "deg",
    "_m_s": "m/s",
    "_m_s2": "m/s²",
    "_rad_s2": "rad/s²",
    "_per_s": "1/s",
    "_frames": "frames",
}


@pytest.mark.parametrize("row", parameter_table(), ids=lambda row: f"{row.group}.{row.name}")
def test_a_parameter_is_described_and_its_name_ends_with_its_unit(row: Parameter) -> None:
    assert row.doc.endswith(".")
    endings = [end for end in ENDINGS if row.name.endswith(end)]
    assert row.unit == (ENDINGS[max(endings, key=len)] if endings else "")


def test_every_default_obeys_its_bounds() -> None:
    pipeline = read_pipeline(ROOT / "pipeline.yaml")
    for row in parameter_table():
        sets = [f"{row.group}.{row.name}={json.dumps(row.value)}"]
        assert settings(pipeline, {}, Path("action.yaml"), sets).params == Params()


def test_the_page_of_parameters_is_up_to_date() -> None:
    page = (ROOT / "docs" / "parameters.md").read_text(encoding="utf-8")
    assert page == tool.document(), "run: python tools/make_parameter_docs.py"


def test_stages_and_core_never_take_defaults_that_are_not_in_their_key() -> None:
    """A group made in code would escape the keys, which hold the values of the run's groups."""
    groups = {type(getattr(Params(), name)).__name__ for name in vars(Params())} | {"Params"}
    files = [*(ROOT / "stages").glob("*.py"), *(ROOT / "imocap_core").rglob("*.py")]
    made = [
        f"{file.relative_to(ROOT)}:{node.lineno}"
        for file in files
        for node in ast.walk(ast.parse(file.read_bytes()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in groups
        if not file.is_relative_to(ROOT / "imocap_core" / "params")
        and file != ROOT / "imocap_core" / "pipeline" / "graph.py"
    ]
    assert made == []
