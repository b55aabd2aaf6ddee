"""docs/artifacts.md says what the schemas say."""

from pathlib import Path

import yaml

from tools import make_artifact_docs as tool

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_is_up_to_date() -> None:
    assert (ROOT / "docs" / "artifacts.md").read_text() == tool.document(), (
        "run: python tools/make_artifact_docs.py"
    )
    graph = yaml.safe_load((ROOT / "pipeline.yaml").read_text())["stages"]
    assert list(tool.BY_STAGE) == list(graph)
