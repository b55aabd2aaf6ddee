"""The truth is for scoring: no stage before `evaluate` can open it."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
import yaml

from imocap_core.pipeline.source import PROJECT, closure

READERS = {"imocap_core.io.truth"}
GRAPH = yaml.safe_load((PROJECT / "pipeline.yaml").read_text())["stages"]
BEFORE = [PROJECT / spec["script"] for name, spec in GRAPH.items() if name != "evaluate"]


def test_the_graph_gives_it_to_evaluate_alone() -> None:
    assert [name for name, spec in GRAPH.items() if "truth" in spec["reads"]] == ["evaluate"]


@pytest.mark.parametrize("script", BEFORE, ids=lambda script: script.stem)
def test_no_earlier_stage_reaches_a_reader_of_it(script: Path) -> None:
    assert READERS.isdisjoint(closure(script))


@pytest.mark.parametrize("script", BEFORE, ids=lambda script: script.stem)
def test_no_earlier_stage_names_it(script: Path) -> None:
    named = {
        node.attr if isinstance(node, ast.Attribute) else node.value
        for node in ast.walk(ast.parse(script.read_text()))
        if isinstance(node, ast.Attribute)
        or (isinstance(node, ast.Constant) and node.value in ("truth", "truth.npz"))
    }
    assert named.isdisjoint({"truth", "truth.npz"})


def test_evaluate_does() -> None:
    found = closure(PROJECT / GRAPH["evaluate"]["script"])
    assert not READERS.isdisjoint(found)
