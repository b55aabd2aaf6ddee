"""The complete example of a stage, in the docstring of imocap_core.pipeline.stage, works."""

import json
import re
import sys
from textwrap import dedent

import numpy as np
import yaml

from imocap_core.artifacts.store import Store
from imocap_core.cli import main
from imocap_core.pipeline import stage
from imocap_core.pipeline.source import PROJECT

ACTION = """\
name: clip
videos:
  - {id: v1, keypoints: v1.npz, format: npz, layout: coco17, fps: 30, size: [640, 360]}
"""


def example() -> dict[str, str]:
    """The files that the docstring shows, by their paths."""
    text = stage.__doc__ or ""
    block = text.split("which a test runs:\n")[1].split("\nWhat the runner promises")[0]
    parts = re.split(r"^# ((?:pipeline\.yaml|stages/\w+\.py))$", dedent(block), flags=re.M)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def test_the_example_runs_and_its_artifact_is_stored(tmp_path, monkeypatch):
    files = example()
    graph = yaml.safe_load((PROJECT / "pipeline.yaml").read_text())
    added = yaml.safe_load(files.pop("pipeline.yaml"))["stages"]
    graph["stages"] = {"keypoints": graph["stages"]["keypoints"], **added}
    (tmp_path / "pipeline.yaml").write_text(yaml.safe_dump(graph, sort_keys=False))
    (script,) = files
    (tmp_path / script).parent.mkdir()
    (tmp_path / script).write_text(files[script])

    person = np.random.default_rng(0).uniform([300, 100, 0.9], [360, 260, 0.9], size=(17, 3))
    keypoints = np.tile(person, (10, 1, 1))
    keypoints[:5, 9] = (np.nan, np.nan, 0.0)  # one joint, unseen in half of the frames
    folder = tmp_path / "actions" / "clip"
    folder.mkdir(parents=True)
    np.savez(folder / "v1.npz", keypoints=keypoints)
    (folder / "action.yaml").write_text(ACTION)

    (name,) = added
    monkeypatch.setattr(sys, "argv", ["imocap"])
    monkeypatch.setenv("IMOCAP_ALLOW_SCRIPTS", "")  # which the option changes
    assert main(["--root", str(tmp_path), "--allow-scripts", "stage", name, "clip"]) == 0
    stored = Store(tmp_path / "artifacts").load("clip", name)
    shares = json.loads(stored.content.header)["share_visible"]["v1"]
    assert shares[9] == 0.5
    assert shares[:9] + shares[10:] == [1.0] * 16
