"""Code counts by what it does; a key changes when, and only when, something that the result depends
on does."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pytest

from imocap_core.errors import WorkFailed
from imocap_core.pipeline import source
from imocap_core.pipeline.keys import differences
from imocap_core.pipeline.source import closure, content_digest
from imocap_core.pipeline.stage import Recipe

FILES = {
    "imocap_core/__init__.py": '"""Core."""\n',
    "imocap_core/maths.py": "def add(a, b):\n    return a + b\n",
    "imocap_core/room/__init__.py": (
        '"""A room."""\nfrom imocap_core.room.one import one\nfrom .two import two as zwei\n'
        '__all__ = ["one", "zwei"]\n'
    ),
    "imocap_core/room/one.py": "from imocap_core.maths import add\n\ndef one():\n    return add\n",
    "imocap_core/room/two.py": "import numpy\n\ndef two():\n    return 2\n",
    "imocap_core/body/__init__.py": "from imocap_core.body.model import load\n",
    "imocap_core/body/model.py": "def load():\n    return 1\n",
    "imocap_core/body/data/body.npz": "bytes",
    "stages/__init__.py": "",
    "stages/params.py": "X = 1\n",
    "stages/harness/__init__.py": "",
    "stages/harness/stage.py": "from imocap_core.room import zwei\n",
    "stages/sync.py": (
        "from imocap_core.room import one\nfrom imocap_core.pipeline.stage import Context\n"
        "from imocap_core.params import X\n"
    ),
    "stages/lazy.py": (
        "def run():\n    from imocap_core import maths\n    import imocap_core.room.two\n"
    ),
    "stages/pose.py": "from imocap_core.body import load\n",
    "stages/whole.py": "import imocap_core.room\n",
}


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(source, "PROJECT", tmp_path.resolve())
    forget()
    yield tmp_path
    forget()


def forget() -> None:
    for cached in (source._find, source._reexports, source._data_files):
        cached.cache_clear()


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    forget()


def test_one_name_of_a_room_is_not_the_whole_room(project: Path) -> None:
    found = set(closure(project / "stages/sync.py"))
    assert found == {"stages.sync", "imocap_core.room.one", "imocap_core.maths"}


def test_a_room_as_a_whole_is_all_of_it(project: Path) -> None:
    found = set(closure(project / "stages/whole.py"))
    assert {"imocap_core.room", "imocap_core.room.one", "imocap_core.room.two"} <= found


def test_imports_inside_functions_count(project: Path) -> None:
    found = set(closure(project / "stages/lazy.py"))
    assert found == {"stages.lazy", "imocap_core.maths", "imocap_core.room.two"}


def test_comments_layout_and_docstrings_don_t_count(project: Path) -> None:
    before = closure(project / "stages/sync.py")
    edit(
        project / "imocap_core/maths.py",
        "    return a + b",
        '    """Sum."""\n    # so\n    return (a  +  b)',
    )
    assert closure(project / "stages/sync.py") == before


def test_what_the_code_does_counts(project: Path) -> None:
    before = closure(project / "stages/sync.py")
    edit(project / "imocap_core/maths.py", "a + b", "a - b")
    after = closure(project / "stages/sync.py")
    assert {n for n in after if after[n] != before[n]} == {"imocap_core.maths"}


def test_the_harness_and_other_rooms_don_t_count(project: Path) -> None:
    before = closure(project / "stages/sync.py")
    edit(project / "imocap_core/room/two.py", "return 2", "return 3")
    edit(project / "stages/params.py", "X = 1", "X = 2")
    assert closure(project / "stages/sync.py") == before


def test_where_a_name_comes_from_counts(project: Path) -> None:
    edit(project / "imocap_core/room/__init__.py", "imocap_core.room.one", "imocap_core.room.two")
    assert "imocap_core.room.two" in closure(project / "stages/sync.py")


def test_data_files_of_a_package_count(project: Path) -> None:
    before = closure(project / "stages/pose.py")
    assert "imocap_core.body.model" in before
    edit(project / "imocap_core/body/data/body.npz", "bytes", "other")
    after = closure(project / "stages/pose.py")
    assert {n for n in after if after[n] != before[n]} == {"imocap_core.body"}


def test_a_script_elsewhere_has_its_own_name(project: Path, tmp_path: Path) -> None:
    script = tmp_path / "toys" / "mine.py"
    script.parent.mkdir()
    script.write_text("from imocap_core.maths import add\n")
    assert set(closure(script)) == {"mine.py", "imocap_core.maths"}


RECIPE = Recipe(
    code={"stages.sync": "c1", "imocap_core.sync.warp.dtw": "c2"},
    params={"sync": {"method": "als", "rank": 3}},
    seed=7,
    inputs={"initial_smpl": "i1"},
    reads={"videos v1": "r1"},
)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"code": {"stages.sync": "c1"}}, ["code: imocap_core.sync.warp.dtw is gone"]),
        ({"code": {**RECIPE.code, "new": "c3"}}, ["code: new is new"]),
        ({"params": {"sync": {"method": "svt", "rank": 3}}}, ["sync.method: als -> svt"]),
        ({"params": {"sync": {"method": "als"}}}, ["sync.rank: 3 -> absent"]),
        ({"seed": 8}, ["seed: 7 -> 8"]),
        ({"inputs": {"initial_smpl": "i2"}}, ["input: initial_smpl has changed"]),
        ({"reads": {"videos v1": "r2"}}, ["read: videos v1 has changed"]),
        ({"format": 0}, ["the way artifacts are made has changed"]),
    ],
)
def test_each_part_counts_and_is_named(change: dict[str, object], said: list[str]) -> None:
    now = dataclasses.replace(RECIPE, **change)
    assert now.key != RECIPE.key
    assert differences(RECIPE.provenance(), now) == said


def test_order_does_not_count() -> None:
    turned = dataclasses.replace(
        RECIPE,
        code=dict(reversed(RECIPE.code.items())),
        params={"sync": {"rank": 3, "method": "als"}},
    )
    assert turned.key == RECIPE.key
    assert differences(RECIPE.provenance(), turned) == []


def test_a_folder_is_its_files_and_their_names(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        (folder / "sub").mkdir(parents=True)
        (folder / "a.json").write_text("1")
        (folder / "sub" / "b.json").write_text("2")
    assert content_digest(one) == content_digest(two)
    (two / "sub" / "b.json").rename(two / "b.json")
    assert content_digest(one) != content_digest(two)
    with pytest.raises(WorkFailed, match="cannot read"):
        content_digest(tmp_path / "nowhere")
