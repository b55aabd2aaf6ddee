"""`imocap clean`: old results and leftovers go, what is in use stays."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from imocap_core.artifacts.file_memory import exclusive
from imocap_core.cli.action_commands import size_text
from imocap_core.errors import WrongUse
from imocap_core.library import cleaning
from imocap_core.library.cleaning import bytes_of, clean

if TYPE_CHECKING:
    from tests.pipeline.conftest import Toy

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def used(toy: Toy) -> Toy:
    """Two runs of the toy: the results of the first are no longer current, but for `gather`."""
    assert toy.imocap(["run", "toy"]) == 0
    assert toy.imocap(["run", "toy", "--set", "sync.method=als"]) == 0
    return toy


def results(toy: Toy) -> list[str]:
    files = (toy.root / "artifacts" / ".cache").glob("*/*.mcap")
    return sorted(file.parent.name for file in files)


def test_without_options_only_leftovers_go(used: Toy, capsys: Capture) -> None:
    leftover = used.root / "artifacts" / "toy" / ".scale.mcap.12.part"
    leftover.write_bytes(b"half")
    before = results(used)
    capsys.readouterr()
    assert used.imocap(["clean"]) == 0
    shown = capsys.readouterr().out
    assert "Removed 0 results (0 B) and 1 leftover (4 B)." in shown
    assert "give --older DAYS or --max-size SIZE" in shown
    assert not leftover.exists()
    assert results(used) == before


def test_old_results_go_and_current_ones_stay(used: Toy, capsys: Capture) -> None:
    digests = used.digests()
    assert results(used) == ["evaluate", "evaluate", "gather", "scale", "scale"]
    assert used.imocap(["clean", "--older", "1"]) == 0
    assert len(results(used)) == 5  # all were used today
    assert used.imocap(["clean", "--older", "0", "--dry-run"]) == 0
    assert len(results(used)) == 5
    assert "Would remove 2 results" in capsys.readouterr().out
    assert used.imocap(["clean", "--older", "0"]) == 0
    shown = capsys.readouterr().out
    assert "Removed 2 results" in shown
    assert [row.split()[0] for row in shown.splitlines()[1:4]] == ["evaluate", "gather", "scale"]
    assert results(used) == ["evaluate", "gather", "scale"]
    assert used.digests() == digests
    used.ran()
    assert used.imocap(["run", "toy", "--set", "sync.method=als"]) == 0
    assert used.ran() == []
    assert used.imocap(["run", "toy"]) == 0  # what was removed is made again
    assert used.ran() == ["scale", "evaluate"]


def test_results_go_until_the_cache_fits_the_oldest_first(used: Toy, capsys: Capture) -> None:
    files = sorted((used.root / "artifacts" / ".cache").glob("*/*.mcap"))
    total = sum(file.stat().st_size for file in files)
    old = clean(older_days=0.0, dry_run=True, root=used.root)
    (oldest,) = (f for f in files if f.parent.name == "scale" and f.stat().st_nlink == 1)
    os.utime(oldest, (0.0, 0.0))
    assert used.imocap(["clean", "--max-size", f"{total - 1}B"]) == 0
    assert not oldest.exists()
    assert len(results(used)) == 4
    capsys.readouterr()
    assert used.imocap(["clean", "--max-size", "0"]) == 0
    assert len(results(used)) == 3
    stay = size_text(total - old.removed_bytes)
    assert f"The results that must stay take {stay}." in capsys.readouterr().out


def test_an_action_s_results_only(used: Toy, capsys: Capture) -> None:
    other = used.root / "actions" / "other"
    other.mkdir()
    text = (used.action / "action.yaml").read_text().replace("name: toy", "name: other")
    (other / "action.yaml").write_text(text)
    for name in ("v1.txt", "v2.txt"):
        (other / name).write_text("5")
    assert used.imocap(["run", "other"]) == 0
    assert used.imocap(["run", "other", "--set", "sync.method=als"]) == 0
    assert len(results(used)) == 10
    assert used.imocap(["clean", "other", "--older", "0"]) == 0
    assert len(results(used)) == 8
    assert "Removed 2 results" in capsys.readouterr().out
    assert used.imocap(["clean", "nobody", "--older", "0"]) == 2
    assert "nobody" in capsys.readouterr().err


def test_nothing_is_removed_while_a_run_is_in_progress(used: Toy, capsys: Capture) -> None:
    with exclusive(used.root / "artifacts" / "toy" / ".lock", lambda: None):
        assert used.imocap(["clean", "--older", "0"]) == 1
    assert "a run of toy is in progress" in capsys.readouterr().err
    assert len(results(used)) == 5


def test_detections_of_an_action_that_cannot_be_read_stay(used: Toy) -> None:
    folder = used.root / "artifacts" / ".cache" / "detections"
    folder.mkdir()
    (folder / "a.npz").write_bytes(b"x")
    clean(older_days=0.0, dry_run=True, root=used.root)
    (used.action / "action.yaml").write_text("videos: 3")
    clean(older_days=0.0, root=used.root)
    assert (folder / "a.npz").exists()
    (used.action / "action.yaml").unlink()
    clean(older_days=0.0, root=used.root)
    assert not (folder / "a.npz").exists()


def test_an_empty_folder_has_nothing_to_clean(tmp_path: Path, toy: Toy, capsys: Capture) -> None:
    assert toy.imocap(["clean", "--older", "0"]) == 0
    assert "Removed 0 results (0 B) and 0 leftovers (0 B)." in capsys.readouterr().out


def test_sizes() -> None:
    assert [bytes_of(t) for t in ("10", "2GB", "1.5 kb", "3 MB")] == [
        10,
        2 * 10**9,
        1500,
        3 * 10**6,
    ]
    assert [size_text(n) for n in (0, 999, 1500, 2 * 10**9)] == ["0 B", "999 B", "1.5 kB", "2.0 GB"]
    with pytest.raises(WrongUse, match="invalid size 'much'"):
        bytes_of("much")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["clean", "--max-size", "two"], "invalid size 'two': expected a number with KB, MB, GB"),
        (["clean", "--older", "-1"], "--older"),
        (["clean", "--older", "soon"], "--older"),
    ],
)
def test_wrong_options(toy: Toy, capsys: Capture, words: list[str], message: str) -> None:
    assert toy.imocap(words) == 2
    assert message in capsys.readouterr().err


def test_without_a_limit_nothing_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMOCAP_CACHE_LIMIT", "0")
    monkeypatch.setattr(cleaning, "cached_results", lambda folder: pytest.fail("looked"))
    assert cleaning.keep_cache_within_limit(Path("no such folder")) == []


def test_a_run_keeps_the_cache_within_its_limit(
    used: Toy, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("IMOCAP_CACHE_LIMIT", "0")
    assert used.imocap(["run", "toy"]) == 0
    every = len(list((used.root / "artifacts" / ".cache").glob("*/*.mcap")))
    monkeypatch.setenv("IMOCAP_CACHE_LIMIT", "1 B")
    assert used.imocap(["run", "toy"]) == 0
    assert "(IMOCAP_CACHE_LIMIT)" in capsys.readouterr().out
    remaining = list((used.root / "artifacts" / ".cache").glob("*/*.mcap"))
    assert 3 <= len(remaining) < every
    assert used.imocap(["run", "toy"]) == 0
    assert "all cached" in capsys.readouterr().out
    monkeypatch.setenv("IMOCAP_CACHE_LIMIT", "much")
    assert used.imocap(["run", "toy"]) == 2
    assert "IMOCAP_CACHE_LIMIT: invalid size" in capsys.readouterr().err
