"""What is installed is enough to work in any folder: code, pipeline.yaml, the body, the licence."""

import zipfile
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    folder = tmp_path_factory.mktemp("wheel")
    (built,) = WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])
    return zipfile.ZipFile(built)


def test_the_defaults_are_inside(wheel: zipfile.ZipFile) -> None:
    assert wheel.read("imocap_core/pipeline.yaml") == (ROOT / "pipeline.yaml").read_bytes()


def test_code_and_data_are_inside(wheel: zipfile.ZipFile) -> None:
    inside = set(wheel.namelist())
    for package, place in {"imocap": "", "imocap_core": "", "stages": "imocap_core/"}.items():
        files = {p.relative_to(ROOT).as_posix() for p in (ROOT / package).rglob("*.*")}
        assert {place + file for file in files if "__pycache__" not in file} <= inside
    assert "imocap_core/body/data/free_body.npz" in inside


def test_nothing_else_is(wheel: zipfile.ZipFile) -> None:
    tops = {name.split("/")[0] for name in wheel.namelist()}
    assert {t for t in tops if not t.endswith(".dist-info")} == {"imocap", "imocap_core"}
    (notices,) = (n for n in wheel.namelist() if n.endswith("licenses/NOTICE"))
    assert b"CC0" in wheel.read(notices)
