"""The notebook of examples/ runs from its first cell to its last, on a small action."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.library.conftest import SmallRun

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "examples" / "ten_things.ipynb"


def test_it_holds_no_outputs() -> None:
    nbformat = pytest.importorskip("nbformat", reason="the extra dev is not installed")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len([c for c in notebook.cells if c.source.startswith("## ")]) == 10
    assert all(cell.outputs == [] and cell.execution_count is None for cell in cells)
    assert NOTEBOOK.stat().st_size < 30_000


@pytest.mark.filterwarnings("ignore")  # of Jupyter's own event loops
def test_it_runs(small_run: SmallRun) -> None:
    nbformat = pytest.importorskip("nbformat", reason="the extra dev is not installed")
    nbclient = pytest.importorskip("nbclient", reason="the extra dev is not installed")
    pytest.importorskip("ipykernel", reason="the extra dev is not installed")
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    client = nbclient.NotebookClient(
        notebook, timeout=300, resources={"metadata": {"path": str(small_run.root)}}
    )
    paths = [str(ROOT), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    client.execute(
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(paths),
            "IMOCAP_ROOT": str(small_run.root),
            "IMOCAP_ACTION": "serve",
        }
    )
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    pictures = [o for cell in cells for o in cell.outputs if "image/png" in o.get("data", {})]
    assert len(pictures) == 6
    errors = [o for cell in cells for o in cell.outputs if o.get("name") == "stderr"]
    assert errors == []
