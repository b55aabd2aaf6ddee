"""What is asked of Blender, and what is said when it fails; needs none."""

import sys
from pathlib import Path

import pytest

from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.export.blender import HERE, blender_program, command, run_in_blender
from imocap_core.export.export_options import ExportOptions
from imocap_core.export.formats import check_format


def test_a_blender_and_a_python_get_the_same_script() -> None:
    script = Path("convert.py")
    assert command(Path("/opt/blender-4.5/blender"), script, "jobs.json") == [
        "/opt/blender-4.5/blender", "--background", "--factory-startup", "--python-exit-code", "1",
        "--python", "convert.py", "--", "jobs.json",
    ]  # fmt: skip
    assert command(Path("python3"), script, "a") == ["python3", "-P", "convert.py", "--", "a"]


def test_a_python_without_bpy_is_named(tmp_path: Path) -> None:
    (tmp_path / "convert.py").write_text("import no_such_module_as_bpy")
    with pytest.raises(
        WorkFailed, match=r"no_such_module_as_bpy.*IMOCAP_BLENDER must name"
    ) as said:
        run_in_blender(Path(sys.executable), tmp_path / "convert.py", "jobs.json")
    assert "\n" not in str(said.value)
    with pytest.raises(WorkFailed, match="cannot start"):
        run_in_blender(tmp_path / "nothing", tmp_path / "convert.py", "jobs.json")


def test_a_blender_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMOCAP_BLENDER", "/no/such/blender")
    with pytest.raises(WorkFailed, match="IMOCAP_BLENDER: the program /no/such/blender does not"):
        blender_program(lambda step: None)


def test_blender_is_pinned_with_hashes() -> None:
    blocks = (HERE / "bpy.txt").read_text().split("\n", 1)[1].split("\n\n")[0]
    assert [line.split("==")[0] for line in blocks.splitlines() if "==" in line] == ["bpy", "numpy"]
    assert blocks.count("--hash=sha256:") > 4


def test_fbx_has_its_own_axes_and_unit() -> None:
    with pytest.raises(WrongUse, match="an FBX file is y up"):
        check_format("fbx", "z")
    check_format("usd", "z")
    ExportOptions(names="ue5", root_bone=True).check("usd")
