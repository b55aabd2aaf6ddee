"""A run as one document for scripts: what it states agrees with the result itself."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from imocap_core.cli.options import plain
from imocap_core.library.run_document import run_document
from imocap_core.library.running import run_action

if TYPE_CHECKING:
    from tests.library.conftest import SmallRun


@pytest.fixture(scope="module")
def document(small_run: SmallRun) -> dict[str, Any]:
    done = run_action("serve", root=small_run.root)
    text = json.dumps(plain(run_document(done)), allow_nan=False)
    return dict(json.loads(text))


def test_the_stages_are_those_of_the_run(document: dict[str, Any]) -> None:
    assert document["stages"][0]["stage"] == "keypoints"
    assert {row["how"] for row in document["stages"]} == {"cached"}


def test_its_verdict_is_the_result_s(document: dict[str, Any], small_run: SmallRun) -> None:
    verdict = small_run.result.verdict
    assert verdict is not None
    assert document["trusted"] is verdict.trusted
    assert document["level"] == verdict.level
    assert document["summary"] == list(verdict.summary)
    sentences = [f.sentence for f in verdict.findings]
    assert set(document["warnings"]) <= set(sentences)
    assert [f["sentence"] for f in document["verdict"]["findings"]] == sentences
    assert all(f.sentence in document["warnings"] for f in verdict.findings if f.serious)


def test_its_correspondences_are_the_result_s(
    document: dict[str, Any], small_run: SmallRun
) -> None:
    rows = {row["video"]: row for row in document["sync"]["videos"]}
    assert tuple(rows) == small_run.result.ids
    assert document["sync"]["reference"] == small_run.result.reference
    assert [name for name, row in rows.items() if row["reference"]] == [small_run.result.reference]
    assert [name for name, row in rows.items() if row["excluded"]] == document["excluded"]
    assert all(0 <= row["matched"] <= 1 and row["frames"] == 24 for row in rows.values())


def test_its_cameras_are_the_result_s(document: dict[str, Any], small_run: SmallRun) -> None:
    for camera in document["cameras"]:
        expected = small_run.result.cameras[camera["video"]]
        np.testing.assert_allclose(camera["R"], expected.R)
        np.testing.assert_allclose(camera["t"], expected.t)
        assert np.shape(camera["K"]) == (3, 3)


def test_an_early_end_leaves_out_what_was_not_reached(small_run: SmallRun) -> None:
    early = run_document(run_action("serve", root=small_run.root, until="sync"))
    assert early["trusted"] is None
    assert early["cameras"] is None
    assert early["sync"]["reference"] in small_run.result.ids
