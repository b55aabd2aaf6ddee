"""`imocap params`: every parameter with its value, unit, bounds and meaning."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import TYPE_CHECKING

import pytest

from imocap_core.params import Params

if TYPE_CHECKING:
    from tests.pipeline.conftest import Toy

Capture = pytest.CaptureFixture[str]


def test_a_group_lists_its_parameters_and_no_others(toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["params", "sync"]) == 0
    heads = [line for line in capsys.readouterr().out.splitlines() if not line.startswith(" ")]
    names = [head.split(" = ")[0] for head in heads]
    assert names == [f"sync.{field.name}" for field in fields(Params().sync)]
    (method,) = (head for head in heads if head.startswith("sync.method = "))
    assert "als" in method
    assert "svt" in method


def test_values_of_pipeline_yaml_stand_beside_their_defaults(toy: Toy, capsys: Capture) -> None:
    default = Params().sync.max_rate
    file = toy.root / "pipeline.yaml"
    file.write_text(file.read_text().replace("method: softmap", "max_rate: 12.5"))
    assert toy.imocap(["params", "sync"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (line,) = (line for line in lines if line.startswith("sync.max_rate = "))
    assert line.startswith("sync.max_rate = 12.5  (")
    assert line.endswith(f"default {default})")


def test_all_parameters_as_json(toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["params", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["parameters"]
    assert {row["group"] for row in rows} == {field.name for field in fields(Params)}
    assert all(row["doc"] and row["bounds"] for row in rows)


def test_an_unknown_group_is_refused(toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["params", "magic"]) == 2
    assert "no group of parameters 'magic' (the groups are: detect" in capsys.readouterr().err
