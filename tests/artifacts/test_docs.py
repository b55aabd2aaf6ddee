"""docs/artifacts.md says what the schemas say."""

import importlib.util
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_is_up_to_date() -> None:
    file = ROOT / "tools" / "make_artifact_docs.py"
    spec = importlib.util.spec_from_file_location("make_artifact_docs", file)
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    assert (ROOT / "docs" / "artifacts.md").read_text() == tool.document(), (
        "run: python tools/make_artifact_docs.py"
    )
    graph = yaml.safe_load((ROOT / "pipeline.yaml").read_text())["stages"]
    assert list(tool.BY_STAGE) == list(graph)
