"""Artifact of `evaluate`: tables, and the names of the files of the report."""

from __future__ import annotations

from pydantic import model_validator

from imocap_core.artifacts.schemas.base import Artifact, Value

Cell = str | bool | int | float | None  # None: could not be scored


class Table(Value):
    """Rows of equal length under named columns; units are part of a column's name."""

    name: str
    title: str
    columns: list[str]
    rows: list[list[Cell]]
    note: str = ""

    @model_validator(mode="after")
    def _rectangular(self) -> Table:
        for i, row in enumerate(self.rows):
            if len(row) != len(self.columns):
                raise ValueError(
                    f"table {self.name}: row {i} has {len(row)} cells, expected {len(self.columns)}"
                )
        return self


class Evaluate(Artifact):
    """Tables of metrics, and the files of report/."""

    tables: list[Table]
    files: list[str]  # relative to report/
