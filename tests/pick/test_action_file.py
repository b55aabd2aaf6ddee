"""action.yaml is written whole, checked, never over another program's change, and back again."""

from pathlib import Path

import pytest

from imocap_core.errors import WorkFailed
from imocap_core.pick.edits import AddAnchorEdit, Edit, FramesEdit, MirroredEdit
from imocap_core.pick.session import ActionFile, ChangedElsewhere

TEXT = """\
name: made   # mine
videos:
  - {id: v1, video: a.mp4, keypoints: detect}
  - {id: v2, video: b.mp4, keypoints: detect}
anchors:
  - {v1: 10, v2: 10}
"""
MIRROR: list[Edit] = [MirroredEdit(kind="mirrored", video="v1", mirrored=True)]


@pytest.fixture
def made(tmp_path: Path) -> ActionFile:
    (tmp_path / "action.yaml").write_text(TEXT)
    return ActionFile(tmp_path)


def test_steps_go_back_and_forward(made: ActionFile) -> None:
    first = made.read()
    second = made.edit(first.revision, MIRROR, {})
    span: list[Edit] = [FramesEdit(kind="frames", video="v2", frames=(5, 20))]
    third = made.edit(second.revision, span, {})
    assert made.file.read_text() == third.text
    assert made.undo(third.revision) == second
    assert made.undo(second.revision) == first
    assert made.file.read_text() == TEXT
    assert not made.can_undo(first)
    assert made.redo(first.revision) == second
    other = made.edit(second.revision, span[:1] + MIRROR, {})
    assert not made.can_redo(other)
    with pytest.raises(ValueError, match="nothing to do again"):
        made.redo(other.revision)


def test_what_changes_nothing_is_no_step(made: ActionFile) -> None:
    first = made.read()
    same = made.edit(first.revision, [MirroredEdit(kind="mirrored", video="v1", mirrored=None)], {})
    assert same == first
    assert not made.can_undo(first)


def test_another_programs_change_is_not_overwritten(made: ActionFile) -> None:
    before = made.read()
    made.edit(before.revision, MIRROR, {})
    edited_elsewhere = TEXT + "# a note\n"
    made.file.write_text(edited_elsewhere)
    for change in (
        lambda: made.edit(before.revision, MIRROR, {}),
        lambda: made.undo(before.revision),
    ):
        with pytest.raises(ChangedElsewhere, match="changed by another program"):
            change()
    present = made.read()
    assert present.text == edited_elsewhere
    assert not made.can_undo(present)
    with pytest.raises(ValueError, match="nothing to undo"):
        made.undo(present.revision)


def test_what_the_model_refuses_is_not_written(made: ActionFile) -> None:
    crossing: list[Edit] = [AddAnchorEdit(kind="add_anchor", frames={"v1": 20, "v2": 5})]
    with pytest.raises(WorkFailed, match="contradict the order of time"):
        made.edit(made.read().revision, crossing, {})
    assert made.file.read_text() == TEXT
    assert [p.name for p in made.folder.iterdir()] == ["action.yaml"]


def test_a_text_that_is_no_action_is_a_sentence(made: ActionFile) -> None:
    made.file.write_text("name: [")
    with pytest.raises(WorkFailed, match="is not YAML"):
        made.action(made.read())
    made.file.write_bytes(b"name: \xff")
    with pytest.raises(WorkFailed, match="cannot read"):
        made.read()
