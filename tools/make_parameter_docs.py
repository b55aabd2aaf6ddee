"""Write docs/parameters.md from the classes: `python tools/make_parameter_docs.py`."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from pathlib import Path

from imocap_core.library.status import Parameter, group_doc, parameter_table
from imocap_core.params import Params

TARGET = Path(__file__).resolve().parents[1] / "docs" / "parameters.md"
HEAD = """\
# Parameters

*Made by `python tools/make_parameter_docs.py` from `imocap_core/params/`; don't edit.*

For one run: `imocap run yoga --set sync.max_rate=8`. For an action: `params: {sync: {max_rate: 8}}`
in its action.yaml. For a folder: the same in its `pipeline.yaml`. The nearest wins, in this order;
unknown names and values outside their bounds are refused. `imocap params` prints all of this.
Each parameter has its default, its unit and the values that it may take.
"""


def document() -> str:
    """The whole page."""
    return HEAD + "".join(_section(f.name) for f in fields(Params))


def _section(group: str) -> str:
    rows = "".join(_row(row) for row in parameter_table(group))
    doc = re.sub(r"\b(\w+\.md)\b", r"[\1](\1)", group_doc(group))
    return f"\n## {group}\n\n{doc}\n\n{rows}"


def _row(row: Parameter) -> str:
    value = row.value if isinstance(row.value, str) else json.dumps(row.value)
    doc = re.sub(r"\((\w+\.md)\)", r"([\1](\1))", row.doc)
    bounds = row.bounds.removeprefix("number ").replace("whole number", "integer")
    unit = f" {row.unit}" if row.unit else ""
    allowed = "" if isinstance(row.value, bool) else f"; {bounds}"
    return f"* **`{row.name}`** `{value}`{unit}{allowed}. {doc}\n"


if __name__ == "__main__":
    TARGET.write_text(document(), encoding="utf-8")
