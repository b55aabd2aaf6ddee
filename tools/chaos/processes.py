"""Processes that work for a run, killed or hung; and a run that is killed while they work."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import yaml

from tests.detect.conftest import MEDIAPIPE, clip
from tools.chaos.small_action import Part, SmallAction, digests_below, part_of, refused

DEMO = "yoga"
DETECTED = "detected"
COLUMNS = [[20, 22, 24, 26, 28, 30], [30, 32, 34, 36, 38, 40]]
HANGS = {"FAKE_DIES_AT": "2", "FAKE_HANGS": "1"}
WAIT_S, STEP_S = 120.0, 0.05
Works = Callable[[], bool]


def disturb_demo(action: SmallAction) -> Part:
    """While the demo's inputs are made: one of its processes killed; then the run itself."""
    folder = action.root / "actions" / DEMO
    begun = lambda: any(folder.parent.glob(f".{DEMO}.*/new/videos/*"))  # noqa: E731
    begin = lambda: action.start("run", "--until", "keypoints", name=DEMO)  # noqa: E731
    wrong: list[str] = []
    process = begin()
    _kill(_workers(process, begun)[-1])
    wrong += refused(process) + _hidden(folder.parent)
    process = begin()
    wrong += _killed_with_workers(process, _workers(process, begun))
    action.finish("run", "--until", "keypoints", name=DEMO)
    expected = digests_below(folder)
    wrong += _hidden(folder.parent) + action.leftovers()
    shutil.rmtree(folder)
    action.finish("run", "--until", "keypoints", name=DEMO)
    wrong += [] if digests_below(folder) == expected else ["another demo"]
    return part_of(2, wrong)


def disturb_detector(action: SmallAction) -> Part:
    """A detector that hangs; one that is killed; a run that is killed while its detector works."""
    faults = _declare_videos(action)
    cache = action.artifacts / ".cache" / "detections"
    run = ("detect",)
    action.finish(*run, name=DETECTED, faults=faults)
    expected = digests_below(cache)
    wrong: list[str] = []

    def ends_well() -> list[str]:
        action.finish(*run, name=DETECTED, faults=faults)
        return (
            [] if digests_below(cache) == expected else ["other detections"]
        ) + action.leftovers()

    shutil.rmtree(cache)
    hung = faults | HANGS | {"CHAOS_ANSWER_S": "15"}
    wrong += refused(action.start(*run, name=DETECTED, faults=hung)) + ends_well()
    shutil.rmtree(cache)
    process = action.start(*run, name=DETECTED, faults=faults | HANGS)
    _kill(_workers(process, lambda: True)[-1])
    wrong += refused(process) + ends_well()
    shutil.rmtree(cache)
    process = action.start(*run, name=DETECTED, faults=faults)
    wrong += _killed_with_workers(process, _workers(process, lambda: True)) + ends_well()
    return part_of(3, wrong)


def _declare_videos(action: SmallAction) -> dict[str, str]:
    """An action of two videos in which a stand-in detects people; the environment that it needs."""
    folder = action.root / "actions" / DETECTED
    for number, columns in enumerate(COLUMNS):
        clip(folder / f"{number}.mp4", list(columns))
    videos = [{"id": f"v{n}", "video": f"{n}.mp4", "keypoints": "detect"} for n in (0, 1)]
    params = {"detect": {"detector": "mediapipe"}}
    content = {"name": DETECTED, "videos": videos, "params": params}
    (folder / "action.yaml").write_text(yaml.safe_dump(content))
    library = action.root / "library"
    library.mkdir()
    (library / "mediapipe.py").write_text(MEDIAPIPE)
    return action.with_library(library)


def _workers(process: subprocess.Popen[bytes], at_work: Works) -> list[int]:
    """The processes that a run has started, once they are at work."""
    for _ in range(round(WAIT_S / STEP_S)):
        children = _children(process.pid)
        if children and at_work():
            return children
        assert process.poll() is None, "it ended before its workers began"
        time.sleep(STEP_S)
    raise AssertionError("no worker has begun")


def _killed_with_workers(process: subprocess.Popen[bytes], workers: list[int]) -> list[str]:
    """SIGKILL of a run; those of its workers that go on."""
    _kill(process.pid)
    process.communicate()
    for _ in range(round(10 / STEP_S)):
        if not any(map(_lives, workers)):
            return []
        time.sleep(STEP_S)
    alive = [worker for worker in workers if _lives(worker)]
    for worker in alive:
        _kill(worker)
    return [f"{len(alive)} processes went on"]


def _children(parent: int) -> list[int]:
    """The processes that a process has started, in their order."""
    pids = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = status.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == parent:
            pids.append(int(status.parent.name))
    return sorted(pids)


def _lives(process: int) -> bool:
    return Path(f"/proc/{process}/exe").exists()


def _kill(process: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)


def _hidden(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob(".*"))
