"""An edit changes what it is about; comments, unknown fields and other lines stay as they are. The
file is written whole, checked, never over another program's change, and back again."""

from copy import deepcopy
from difflib import ndiff
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from imocap_core.errors import WorkFailed
from imocap_core.pick.edits import AddAnchorEdit, Edit, FramesEdit, MirroredEdit, apply_edits
from imocap_core.pick.session import ActionFile, ChangedElsewhere
from imocap_core.pipeline.yaml_file import edited_text

EDITS = TypeAdapter(list[Edit])
COUNTS = {"v1": 90, "v2": 100, "v3": 50}

BLOCKS = """\
# my action
name:   yoga   # its name
mine: {a: 1,   b: "x"}

videos:
  - id: v1   # phone
    video: "videos/v1.mp4"
    keypoints: detect

  # second camera,
  # on a tripod
  - id: v2
    video: videos/v2.mp4
    frames: [0, 82]   # used
    keypoints: detect
    mirrored: ~
  # third
  - id: v3
    video: videos/v3.mp4
anchors:
  # foot
  - {v1: 3, v2: 4}
  - {v1: 13,   v2: 14, v3: 20, hard: true}  # exact
forbidden:
  - {video: v2, frames: [0, 50]}
# before params
params: {sync: {method: als}}
# last
"""
LINES = """\
name: beam
videos:
- {id: v1, video: a.mp4, keypoints: detect}   # left
- {id: v2, video: b.mp4, keypoints: k/b, format: openpose, frames: [9, 93]}
# Truth: for scoring only
- {id: v3, video: c.mp4}
"""


def edited(text: str, *edits: dict[str, Any]) -> str:
    parsed = EDITS.validate_python(list(edits))
    return edited_text(text, lambda data: apply_edits(data, parsed, COUNTS))


def changed_lines(before: str, after: str) -> list[str]:
    return [
        line.rstrip() for line in ndiff(before.splitlines(), after.splitlines()) if line[0] in "+-"
    ]


@pytest.mark.parametrize(
    ("text", "edit", "expected"),
    [
        (
            BLOCKS,
            {"kind": "frames", "video": "v2", "frames": (10, 80)},
            ["-     frames: [0, 82]   # used", "+     frames: [10, 80]  # used"],
        ),
        (BLOCKS, {"kind": "frames", "video": "v1", "frames": (10, 80)}, ["+     frames: [10, 80]"]),
        (BLOCKS, {"kind": "frames", "video": "v1", "frames": (0, 90)}, []),
        (
            BLOCKS,
            {"kind": "person", "video": "v3", "person": {"frame": 30, "at": (1, 2.5)}},
            ["+     person: {frame: 30, at: [1, 2.5]}"],
        ),
        (
            BLOCKS,
            {"kind": "mirrored", "video": "v2", "mirrored": True},
            ["-     mirrored: ~", "+     mirrored: true"],
        ),
        (BLOCKS, {"kind": "mirrored", "video": "v1", "mirrored": None}, []),
        (
            BLOCKS,
            {"kind": "performers", "performers": {"v1": "anna", "v2": "ben", "v3": "anna"}},
            ["+     performer: anna", "+     performer: ben", "+     performer: anna"],
        ),
        (BLOCKS, {"kind": "performers", "performers": None}, []),
        (BLOCKS, {"kind": "event", "event": True}, ["+ event: true"]),
        (BLOCKS, {"kind": "event", "event": False}, []),
        (
            BLOCKS,
            {"kind": "add_forbidden", "video": "v1", "frames": (60, 70)},
            ["+   - {video: v1, frames: [60, 70]}"],
        ),
        (
            BLOCKS,
            {"kind": "forbidden", "number": 0},
            ["- forbidden:", "-   - {video: v2, frames: [0, 50]}"],
        ),
        (BLOCKS, {"kind": "detect", "video": "v3"}, ["+     keypoints: detect"]),
        (
            BLOCKS,
            {"kind": "add_anchor", "frames": {"v1": 40, "v3": 41}},
            ["+   - {v1: 40, v3: 41}"],
        ),
        (
            BLOCKS,
            {"kind": "anchor", "number": 0, "hard": None},
            ["-   # foot", "-   - {v1: 3, v2: 4}"],
        ),
        (
            BLOCKS,
            {"kind": "drop", "video": "v3"},
            [
                "-   # third",
                "-   - id: v3",
                "-     video: videos/v3.mp4",
                "-   - {v1: 13,   v2: 14, v3: 20, hard: true}  # exact",
                "+   - {v1: 13, v2: 14, hard: true}            # exact",
            ],
        ),
        (
            LINES,
            {"kind": "drop", "video": "v2"},
            ["- - {id: v2, video: b.mp4, keypoints: k/b, format: openpose, frames: [9, 93]}"],
        ),
        (
            LINES,
            {"kind": "person", "video": "v2", "person": {"track": 2}},
            [
                "- - {id: v2, video: b.mp4, keypoints: k/b, format: openpose, frames: [9, 93]}",
                "+ - {id: v2, video: b.mp4, keypoints: k/b, format: openpose, person: {track: 2},"
                " frames: [9, 93]}",
            ],
        ),
        (
            LINES,
            {"kind": "add_anchor", "frames": {"v1": 4, "v2": 10}, "hard": True},
            ["+ anchors:", "+ - {v1: 4, v2: 10, hard: true}"],
        ),
        (
            LINES,
            {"kind": "split", "video": "v2", "starts": [40, 20]},
            [
                "- - {id: v2, video: b.mp4, keypoints: k/b, format: openpose, frames: [9, 93]}",
                "+ - {id: v2, video: b.mp4, keypoints: k/b, format: openpose, frames: [9, 20]}",
                "+ - {id: v2_2, video: b.mp4, keypoints: k/b, format: openpose, frames: [20, 40]}",
                "+ - {id: v2_3, video: b.mp4, keypoints: k/b, format: openpose, frames: [40, 93]}",
            ],
        ),
    ],
)
def test_only_these_lines_change(text: str, edit: dict[str, Any], expected: list[str]) -> None:
    after = edited(text, edit)
    lines = [line for line in changed_lines(text, after) if not line.startswith("?")]
    assert sorted(lines) == sorted(expected)


@pytest.mark.parametrize("text", [BLOCKS, LINES, BLOCKS.replace("\n", "\r\n"), LINES.rstrip("\n")])
def test_the_text_says_what_the_edits_make_of_the_content(text: str) -> None:
    edits: list[dict[str, Any]] = [
        {"kind": "person", "video": "v2", "person": {"frame": 15, "box": (1, 2, 3, 4)}},
        {"kind": "split", "video": "v2", "starts": [50]},
        {"kind": "mirrored", "video": "v2_2", "mirrored": False},
        {"kind": "drop", "video": "v1"},
        {"kind": "frames", "video": "v3", "frames": (4, 30)},
        {"kind": "add_anchor", "frames": {"v2": 20, "v3": 22}},
    ]
    content = yaml.safe_load(text)
    for n in range(len(edits)):
        data = deepcopy(content)
        apply_edits(data, EDITS.validate_python(edits[: n + 1]), COUNTS)
        assert yaml.safe_load(edited(text, *edits[: n + 1])) == data
    assert ("\r\n" in edited(text, edits[0])) == ("\r\n" in text)


def test_comments_survive_what_they_are_beside() -> None:
    after = edited(BLOCKS, {"kind": "drop", "video": "v2"}, {"kind": "drop", "video": "v1"})
    remaining = {line.strip() for line in after.splitlines() if line.strip().startswith("#")}
    assert {"# my action", "# third", "# before params", "# last"} <= remaining
    assert 'mine: {a: 1,   b: "x"}\n' in after


def test_a_comment_goes_with_the_item_that_it_is_above() -> None:
    collected = "name: jumps\nvideos:\n" + "".join(
        f"  # film.mp4, shot {n}\n  - id: v{n}\n    video: film.mp4\n    frames: [{n}0, {n}9]\n"
        for n in (1, 2, 3)
    )
    for n in (1, 2, 3):
        after = edited(collected, {"kind": "drop", "video": f"v{n}"})
        blocks = collected.split("  # ")
        assert after == "  # ".join(b for b in blocks if f"shot {n}\n" not in b)


def test_parts_take_their_anchors_spans_and_performer() -> None:
    text = BLOCKS.replace("mirrored: ~", "person: {frame: 60, at: [5, 6]}")
    data = yaml.safe_load(edited(text, {"kind": "split", "video": "v2", "starts": [10, 40]}))
    parts = {v["id"]: v for v in data["videos"]}
    assert [parts[p]["frames"] for p in ("v2", "v2_2", "v2_3")] == [[0, 10], [10, 40], [40, 82]]
    assert parts["v2"]["person"] is None
    assert "person" not in parts["v2_2"]
    assert parts["v2_3"]["person"] == {"frame": 60, "at": [5, 6]}
    assert data["anchors"][0] == {"v1": 3, "v2": 4}
    assert data["anchors"][1] == {"v1": 13, "v2_2": 14, "v3": 20, "hard": True}
    assert data["forbidden"] == [
        {"video": "v2", "frames": [0, 10]},
        {"video": "v2_2", "frames": [10, 40]},
        {"video": "v2_3", "frames": [40, 50]},
    ]


def test_an_anchor_becomes_exact_and_back() -> None:
    exact = edited(BLOCKS, {"kind": "anchor", "number": 0, "hard": True})
    assert yaml.safe_load(exact)["anchors"][0] == {"v1": 3, "v2": 4, "hard": True}
    loose = edited(exact, {"kind": "anchor", "number": 0, "hard": False})
    assert yaml.safe_load(loose) == yaml.safe_load(BLOCKS)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ({"kind": "drop", "video": "v9"}, "there is no video v9"),
        ({"kind": "frames", "video": "v3", "frames": (4, 60)}, r"within \[0, 50\], as the video"),
        ({"kind": "split", "video": "v2", "starts": [82]}, "between frames 0 and 82"),
        ({"kind": "detect", "video": "v1"}, "has keypoints already: detect"),
        ({"kind": "anchor", "number": 2, "hard": None}, "there is no anchor 3"),
    ],
)
def test_an_edit_that_does_not_fit_is_a_sentence(edit: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        edited(BLOCKS, edit)


def test_the_last_video_stays() -> None:
    with pytest.raises(ValueError, match="an action has at least one"):
        edited("name: a\nvideos: [{id: v1, video: a.mp4}]\n", {"kind": "drop", "video": "v1"})


def test_what_cannot_be_written_back_is_refused() -> None:
    twice = "name: a\nname: b\nvideos:\n- {id: v1, video: a.mp4}\n"
    with pytest.raises(WorkFailed, match=r"action\.yaml cannot be changed from here"):
        edited(twice, {"kind": "mirrored", "video": "v1", "mirrored": True})


VIDEOS = st.sampled_from(["v1", "v2", "v3", "v1_2", "v2_2"])
NUMBERS = st.integers(0, 60)
SOME_EDIT = st.one_of(
    st.fixed_dictionaries(
        {"kind": st.just("mirrored"), "video": VIDEOS, "mirrored": st.booleans()}
    ),
    st.fixed_dictionaries(
        {"kind": st.just("frames"), "video": VIDEOS, "frames": st.tuples(NUMBERS, NUMBERS)}
    ),
    st.fixed_dictionaries(
        {"kind": st.just("split"), "video": VIDEOS, "starts": st.lists(NUMBERS, min_size=1)}
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("person"),
            "video": VIDEOS,
            "person": st.one_of(
                st.none(),
                st.fixed_dictionaries({"track": st.integers(1, 5)}),
                st.fixed_dictionaries({"frame": NUMBERS, "at": st.tuples(NUMBERS, NUMBERS)}),
            ),
        }
    ),
    st.fixed_dictionaries({"kind": st.just("drop"), "video": VIDEOS}),
    st.fixed_dictionaries(
        {
            "kind": st.just("add_anchor"),
            "frames": st.dictionaries(VIDEOS, NUMBERS, min_size=2),
            "hard": st.booleans(),
        }
    ),
    st.fixed_dictionaries(
        {
            "kind": st.just("anchor"),
            "number": st.integers(0, 2),
            "hard": st.one_of(st.none(), st.booleans()),
        }
    ),
)


@given(st.sampled_from([BLOCKS, LINES]), st.lists(SOME_EDIT, min_size=1, max_size=6))
def test_any_edits_in_any_order_can_be_written(text: str, edits: list[dict[str, Any]]) -> None:
    """Step by step as on the page: the text follows the content, and no comment at the top goes."""
    content = yaml.safe_load(text)
    for edit in edits:
        parsed = EDITS.validate_python([edit])
        before = deepcopy(content)
        try:
            apply_edits(content, parsed, COUNTS)
        except ValueError:
            content = before
            continue
        text = edited_text(text, lambda data, parsed=parsed: apply_edits(data, parsed, COUNTS))
        assert yaml.safe_load(text) == content
    assert ("# my action" in text) == ("mine:" in text)
    assert ("# last" in text) == ("mine:" in text)


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
