"""Checks that everything the program needs is there and works."""

from __future__ import annotations

import io
import os
import platform
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.builtin_actions import BUILT_IN
from imocap_core.version import __version__
from imocap_core.workspace import Workspace

NEEDED = ("torch", "numpy", "scipy", "opencv-python-headless", "av", "mcap", "protobuf", "pydantic")


@dataclass(frozen=True)
class Check:
    """One thing that was checked: whether it works, and a sentence."""

    works: bool
    sentence: str


def examine(root: str | Path = ".") -> Iterator[Check]:
    """Check one thing after another, whether or not the one before works."""
    workspace = Workspace(Path(root))
    checks: tuple[Callable[[], str], ...] = (
        lambda: (
            f"Python {platform.python_version()} on {platform.system()}, {os.cpu_count()} cores: "
            f"{sys.executable}"
        ),
        lambda: f"imocap {__version__}; {', '.join(f'{n} {metadata.version(n)}' for n in NEEDED)}",
        lambda: f"pipeline: {workspace.pipeline().file}",
        lambda: _folder(workspace),
        lambda: _actions(workspace),
        lambda: _detector(workspace),
        _video,
        _body,
        lambda: _extra("paths of moving cameras", "pycolmap", "moving"),
        _blender,
    )
    for check in checks:
        try:
            yield Check(True, check())
        except WorkFailed as error:
            yield Check(False, str(error))
        except Exception as error:
            yield Check(False, f"{type(error).__name__}: {error}")


def _detector(workspace: Workspace) -> str:
    from imocap_core.detect.detection import is_set_up
    from imocap_core.detect.detectors import detector_of
    from imocap_core.detect.environment import DETECTION

    try:
        detector = detector_of(workspace.pipeline().params.detect, workspace.root)
    except (WorkFailed, WrongUse):  # said of the pipeline
        return "detection: as pipeline.yaml says"
    if is_set_up(detector):
        return f"detection: {detector.packages.stem} is ready"
    return f"detection: the first run fetches {detector.packages.stem} ({DETECTION.size})"


def _extra(use: str, package: str, extra: str) -> str:
    try:
        return f"{use}: {package} {metadata.version(package)}"
    except metadata.PackageNotFoundError:
        return f"{use}: not installed (pip install 'imocap[{extra}]')"


def _blender() -> str:
    from imocap_core.export.blender import BLENDER, is_installed

    named = os.environ.get(BLENDER.variable)
    if named:
        return f"fbx and usd: Blender is {named} ({BLENDER.variable})"
    if is_installed():
        return f"fbx and usd: Blender is in {BLENDER.folder}"
    return f"fbx and usd: Blender is installed by the first such export ({BLENDER.size})"


def _folder(workspace: Workspace) -> str:
    root = workspace.root.resolve()
    if not os.access(root, os.W_OK):
        raise WorkFailed(f"{root} can't be written to; choose another folder with --root")
    return f"working folder: {root}"


def _actions(workspace: Workspace) -> str:
    named = {p.parent.name for p in (workspace.root / "actions").glob("*/action.yaml")}
    return f"actions: {', '.join(sorted({*named, *BUILT_IN}))}"


def _body() -> str:
    from imocap_core.body import load_free_body

    model = load_free_body()
    return f"body model: {model.name} {model.digest[:12]}"


def _video() -> str:
    import av
    import numpy as np

    from imocap_core.io.video import film_encoder

    with av.open(io.BytesIO(), "w", format="mp4") as container:
        encoder = film_encoder()
        stream: Any = container.add_stream(encoder, rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 64, "yuv420p"
        frame = av.VideoFrame.from_ndarray(np.zeros((64, 64, 3), np.uint8), format="rgb24")
        container.mux([*stream.encode(frame), *stream.encode(None)])
    return f"video: films can be written by {encoder}"
