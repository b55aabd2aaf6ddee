"""`imocap run-all` on a cluster whose workers have folders of their own and share a store."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.processes import at_most
from tests.s3_server import needs_s3, s3_store
from tools.dask_cluster import started_cluster

if TYPE_CHECKING:
    from tests.pipeline.conftest import Toy

Capture = pytest.CaptureFixture[str]
pytest.importorskip("distributed", reason="the extra dask is not installed")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="kills a process as Linux does")


def worker_folder(toy: Toy, name: str) -> Path:
    """A working folder with the toy's pipeline and nothing else."""
    root = toy.root / name
    root.mkdir()
    shutil.copy(toy.root / "pipeline.yaml", root)
    shutil.copytree(toy.root / "toys", root / "toys")
    return root


@pytest.fixture(params=["folder", pytest.param("s3", marks=needs_s3)])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    if request.param == "folder":
        (tmp_path / "shared").mkdir()
        yield str(tmp_path / "shared")
    else:
        with s3_store(tmp_path) as url:
            yield url


def test_workers_with_folders_of_their_own_give_what_one_machine_gives(toy, capsys, store):
    assert toy.imocap(["run", "toy"]) == 0
    alone = toy.digests()
    shutil.rmtree(toy.root / "artifacts")
    toy.ran()
    capsys.readouterr()
    roots = [worker_folder(toy, "first"), worker_folder(toy, "second")]
    with at_most(300), started_cluster(roots, {"TOY_SCALE": "kill once"}) as cluster:
        words = ["toy", "--executor", "dask", "--address", cluster.address, "--store", store]
        assert toy.imocap(["run-all", *words, "--json"]) == 0
    (end,) = json.loads(capsys.readouterr().out)["actions"]
    assert [stage["how"] for stage in end["stages"]] == ["made"] * 3
    assert toy.digests() == alone
    assert toy.ran() == ["gather", "scale", "scale", "evaluate"]
    assert any((root / "actions" / "toy" / "v1.txt").is_file() for root in roots)


def test_a_worker_with_another_pipeline_is_a_sentence(toy, capsys, tmp_path):
    (tmp_path / "shared").mkdir()
    root = worker_folder(toy, "first")
    text = (root / "pipeline.yaml").read_text()
    (root / "pipeline.yaml").write_text(text.replace("seed: 7", "seed: 8"))
    with at_most(300), started_cluster([root], {}) as cluster:
        words = ["toy", "--executor", "dask", "--address", cluster.address]
        assert toy.imocap(["run-all", *words, "--store", str(tmp_path / "shared")]) == 1
    assert "has another version of imocap, or another pipeline.yaml" in capsys.readouterr().out
    assert toy.ran() == []
