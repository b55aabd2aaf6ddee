"""`import imocap`: one page of names, each documented; importing changes nothing."""

import inspect
import os
import subprocess
import sys
from pathlib import Path

import pytest

import imocap
from tests.library.conftest import SmallRun


def test_at_most_sixty_names() -> None:
    assert len(imocap.__all__) <= 60
    assert len(set(imocap.__all__)) == len(imocap.__all__)
    public = {n for n, v in vars(imocap).items() if not n.startswith("_")}
    modules = {n for n in public if inspect.ismodule(getattr(imocap, n))}
    assert public - modules == set(imocap.__all__) - {"__version__"}


def test_every_name_is_documented_and_typed() -> None:
    for name in imocap.__all__:
        value = getattr(imocap, name)
        if not callable(value):
            continue
        assert inspect.getdoc(value), name
        function = value.__init__ if inspect.isclass(value) else value
        if inspect.isclass(value) and issubclass(value, Exception):
            continue
        for parameter in inspect.signature(function).parameters.values():
            if parameter.name != "self":
                assert parameter.annotation is not inspect.Parameter.empty, (name, parameter)


def test_public_members_are_documented() -> None:
    for kind in (imocap.Result, imocap.VideoResult, imocap.VideoCamera, imocap.Synchronisation):
        for name in dir(kind):
            member = inspect.getattr_static(kind, name)
            if not name.startswith("_") and (callable(member) or isinstance(member, property)):
                assert inspect.getdoc(member), f"{kind.__name__}.{name}"


def test_importing_changes_no_setting_and_loads_nothing_heavy() -> None:
    code = """
import ctypes, os, sys
before = dict(os.environ)
calls = []
class Library:
    def __init__(self, *_): pass
    def __getattr__(self, name):
        calls.append(name)
        raise AttributeError(name)
real = ctypes.CDLL
ctypes.CDLL = lambda name=None, *a, **k: Library() if name is None else real(name, *a, **k)
import imocap
assert "mallopt" not in calls
ctypes.CDLL = real
heavy = sorted({"torch", "av", "matplotlib", "scipy", "cv2"} & set(sys.modules))
print(heavy, dict(os.environ) == before)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[] True"  # what is not loaded has its own number of threads


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
@pytest.mark.long
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
