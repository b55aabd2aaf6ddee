"""What `make` installs is pinned, with hashes and a licence; what is installed is enough to
work."""

import re
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.wheel import WheelBuilder

from tools import audit, make_licence_table

ROOT = Path(__file__).resolve().parents[2]
LOCKED = (ROOT / "locked.txt").read_text()


def pins(text: str) -> dict[str, str]:
    found = make_licence_table.PIN.findall(text)
    return {re.sub("[_.]", "-", name).lower(): version for name, version in found}


def test_every_constraint_but_torch_is_locked() -> None:
    constraints = pins((ROOT / "constraints.txt").read_text())
    del constraints["torch"]
    assert constraints.items() <= pins(LOCKED).items(), "run: python tools/lock.py"


def test_every_locked_package_has_hashes() -> None:
    blocks = re.split(r"\n(?=[a-z])", LOCKED[LOCKED.index("annotated-doc") :])
    assert len(blocks) == len(pins(LOCKED))
    assert all("--hash=sha256:" in block for block in blocks)
    assert "://" not in LOCKED


def test_every_package_has_its_version_and_licence_on_the_page() -> None:
    rows = make_licence_table.rows_of((ROOT / "docs" / "licences.md").read_text())
    versions = {name: version for name, (version, _) in rows.items()}
    assert versions == make_licence_table.pins_of(ROOT), "run: python tools/make_licence_table.py"
    assert not [name for name, (_, licence) in rows.items() if licence == "not declared"]


@pytest.mark.parametrize(
    ("dependencies", "line", "code"),
    [
        ([{"name": "a", "version": "1", "vulns": []}], "known of 1 packages", 0),
        (
            [{"name": "a", "version": "1", "vulns": []}, {"name": "b", "skip_reason": "?"}],
            "1 of 2",
            2,
        ),
        ([], "only 0 of 0", 2),
        (
            [{"name": "a", "version": "1", "vulns": [{"id": "CVE-1", "fix_versions": ["2"]}]}],
            "a 1: CVE-1, mended in 2",
            1,
        ),
    ],
)
def test_an_audit_that_was_not_made_is_no_success(dependencies, line, code):
    lines, exit_code = audit.outcome(dependencies)
    assert line in lines[0]
    assert exit_code == code


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
