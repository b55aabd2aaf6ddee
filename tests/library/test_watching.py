"""A folder that fills: clips are taken when they are whole, and the action keeps what it has."""

from __future__ import annotations

import shutil
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from imocap_core.errors import WrongUse
from imocap_core.library import watching
from imocap_core.pipeline.action import read_action
from tests.io.made_videos import write_video
from tests.library.conftest import SmallRun


def test_a_file_that_grows_is_waited_for(tmp_path: Path) -> None:
    sizes, waits = [1, 2, 3], 0

    def wait(seconds: float) -> None:
        nonlocal waits
        waits += 1
        if sizes:
            (tmp_path / "a.mp4").write_bytes(b"x" * sizes.pop(0))

    list(islice(watching.settled_changes(tmp_path, wait), 1))
    assert waits == 4  # three sizes, and once more the last
    assert (tmp_path / "a.mp4").stat().st_size == 3


def test_an_action_takes_new_clips_and_keeps_what_it_has(tmp_path: Path) -> None:
    clips = tmp_path / "clips"
    (clips / "more").mkdir(parents=True)
    with pytest.raises(WrongUse, match="expected videos in the folder, got none"):
        watching.bring_up_to_date(tmp_path, clips, "serve")
    for name in ("a.mp4", "b.mp4"):
        write_video(clips / name)
    assert watching.bring_up_to_date(tmp_path, clips, "serve").new == ["a", "b"]
    file = tmp_path / "actions" / "serve" / "action.yaml"
    file.write_text(file.read_text() + "event: true  # one performance\n")
    write_video(clips / "more" / "A.mp4")
    write_video(clips / "\u6df1\u8e72.mp4")
    (clips / "b.mp4").unlink()
    update = watching.bring_up_to_date(tmp_path, clips, "serve")
    assert (update.new, update.gone) == (["v1", "v2"], ["b"])
    assert [v.id for v in read_action(file.parent).videos] == ["a", "v1", "v2"]
    assert "event: true  # one performance" in file.read_text()
    assert watching.bring_up_to_date(tmp_path, clips, None).action == "clips"
    write_video(clips / "c.mp4")
    assert watching.bring_up_to_date(tmp_path, clips, None).new == ["c"]  # watched again
    assert watching.bring_up_to_date(tmp_path, clips, "serve").new == ["c"]
    unchanged = file.read_bytes()
    assert watching.bring_up_to_date(tmp_path, clips, "serve").new == []
    assert file.read_bytes() == unchanged


def test_a_change_is_compared_with_the_last_result(small_run: SmallRun, tmp_path: Path) -> None:
    result = small_run.result
    update = watching.Update("serve", ["v2"], [])
    sentence = watching.compared(update, result, result)
    assert sentence.startswith("2 videos (+v2); the motion of the others moved by 0 mm")
    assert watching.moved_mm(None, result) is None
    (tmp_path / "artifacts" / "serve").mkdir(parents=True)
    for _ in range(2):
        file = watching.record(tmp_path, update, result, result)
    rows = file.read_text(encoding="utf-8").splitlines()
    assert len(rows) == 4
    assert rows[2] == rows[3]
    assert rows[2].startswith("| 2 | v2 |  | 0 | ")
    error = watching.expected_error_mm(result)
    assert error is not None
    assert np.isfinite(error)
    shutil.rmtree(tmp_path / "artifacts")
