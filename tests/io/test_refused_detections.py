"""Every reader of 2D keypoints refuses what is malformed, with a sentence, and runs nothing."""

from __future__ import annotations

import json
import pickle
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imocap_core.io.readers.keypoint_readers import format_and_layout
from tests.io import made_keypoints as made
from tests.io.detector_cases import CASES, FILES, read, refused, written

EACH = pytest.mark.parametrize("case", FILES)


@EACH
@pytest.mark.parametrize("share", [0.0, 0.3, 0.7])
def test_a_truncated_file_is_refused(case: str, share: float, tmp_path: Path) -> None:
    path, _, kind, layout = written(case, tmp_path)
    content = path.read_bytes()
    end = int(share * len(content))
    if path.suffix == ".csv":  # in the middle of a row
        end = content.rfind(b";" if "semicolons" in case else b",", 0, end) + 1
    path.write_bytes(content[:end])
    refused(path, kind, layout)


@EACH
@pytest.mark.parametrize("content", ["7", '"text"', "[1, 2]", "{}", '[{"image_id": "a"}]', "[[]]"])
def test_a_file_of_something_else_is_refused(case: str, content: str, tmp_path: Path) -> None:
    path, _, kind, layout = written(case, tmp_path)
    path.write_text(content)
    refused(path, kind, layout)
    with pytest.raises(ValueError, match=path.name):
        format_and_layout(path, None, None)


NAMED = [n for n in FILES if CASES[n][1] in ("deeplabcut", "sleap", "tfjs") or "csv" in n]


@pytest.mark.parametrize("case", [n for n in FILES if n not in NAMED])
def test_a_file_with_another_number_of_points_is_refused(case: str, tmp_path: Path) -> None:
    write, kind, layout = CASES[case]
    people = {
        f: [p[:-1] for p in in_frame] for f, in_frame in made.people(layout, persons=1).items()
    }
    message = refused(write(tmp_path, people), kind, layout)
    assert "expected" in message


@EACH
def test_a_missing_file_is_refused(case: str, tmp_path: Path) -> None:
    path, _, kind, layout = written(case, tmp_path)
    path.unlink()
    assert "no such file" in refused(path, kind, layout)


@EACH
def test_nobody_in_the_whole_file_is_refused(case: str, tmp_path: Path) -> None:
    write, kind, layout = CASES[case]
    unseen = {f: [np.full_like(p, np.nan) * [1, 1, 0] for p in in_frame]
              for f, in_frame in made.people(layout, persons=1).items()}  # fmt: skip
    for in_frame in unseen.values():
        in_frame[0][:, 2] = 0.0
    path = write(tmp_path, unseen)
    kinds = ("alphapose", "coco", "mmpose", "ultralytics", "mediapipe", "sleap", "openpose", "tfjs")
    if kind in kinds and (path.suffix != ".csv" or kind == "sleap"):
        assert all(np.isnan(p[..., 0]).all() for p in read(path, kind, layout).people)
    else:
        assert "at least one person" in refused(path, kind, layout)


@EACH
@pytest.mark.parametrize("layout", ["smpl24", "hands42"])
def test_a_layout_that_the_format_has_not_is_refused(
    case: str, layout: str, tmp_path: Path
) -> None:
    path, _, kind, _ = written(case, tmp_path)
    refused(path, kind, layout)


def test_a_wrong_layout_is_named_with_the_right_one(tmp_path: Path) -> None:
    path = made.write_alphapose(tmp_path, made.people("halpe26"))
    with pytest.raises(ValueError, match=r"expected 51 numbers .* got 78 numbers; set layout: hal"):
        read(path, "alphapose", "coco17")
    path = made.write_npz(tmp_path, made.people("wholebody133"))
    with pytest.raises(ValueError, match=r"26 points of halpe26, got 133; set layout: wholebody"):
        read(path, "npz", "halpe26")


def test_wrong_entries_are_named(tmp_path: Path) -> None:
    path = made.write_coco(tmp_path, made.people("coco17"))
    entries = json.loads(path.read_text())
    for field, value, message in (
        ("keypoints", ["a"] * 51, r"\[2\].keypoints: expected numbers only"),
        ("keypoints", None, r"\[2\].keypoints: expected a list of numbers, got nothing"),
        ("image_id", "no number", r"\[2\].image_id: expected a frame number"),
        ("image_id", -1, r"\[2\].image_id: expected a frame number"),
        ("image_id", 10**40, r"\[2\].image_id: expected a frame number"),
        ("image_id", True, r"\[2\].image_id: expected a frame number"),
    ):
        changed = [dict(entry) for entry in entries]
        changed[2][field] = value
        path.write_text(json.dumps(changed))
        with pytest.raises(ValueError, match=message):
            read(path, "coco", "coco17")


class Evil:
    """Makes a file when it is unpickled."""

    def __init__(self, victim: Path) -> None:
        self.victim = victim

    def __reduce__(self) -> tuple[Any, ...]:
        return (Path.touch, (self.victim,))


def evil_npz(folder: Path, array: str, victim: Path) -> Path:
    path = folder / "evil.npz"
    arrays = {name: np.array({}, dtype=object) for name in ("positions_2d", "metadata")}
    arrays[array] = np.array({"S1": Evil(victim)}, dtype=object)
    np.savez(path, **arrays)
    return path


@pytest.mark.parametrize("array", ["positions_2d", "metadata"])
def test_a_pickle_in_an_npz_runs_nothing(array: str, tmp_path: Path) -> None:
    victim = tmp_path / "victim"
    path = evil_npz(tmp_path, array, victim)
    layouts = {"metadata": None, "positions_2d": "h36m17"}[array]
    with pytest.raises(ValueError, match="refused, it can't be read safely"):
        read(path, *format_and_layout(path, "cpn_npz", layouts))
    assert not victim.exists()
    pickle.loads(pickle.dumps(Evil(victim)))
    assert victim.exists()  # it would have


@EACH
def test_damaged_files_are_read_or_refused_but_never_fail(case: str, tmp_path: Path) -> None:
    """A few bytes changed, wherever."""
    path, _, kind, layout = written(case, tmp_path)
    whole, rng = path.read_bytes(), random.Random(0)
    for _ in range(25):
        damaged = bytearray(whole)
        for _ in range(rng.randint(1, 4)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        path.write_bytes(bytes(damaged))
        for attempt in (read, format_and_layout):
            try:
                attempt(path, kind, layout if attempt is read else None)
            except ValueError as error:
                assert str(path) in str(error)  # noqa: PT017
