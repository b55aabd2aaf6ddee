"""Twenty actions by every executor: clock times in one go, and whether all results are equal.

``python -m tools.measure_run_all ROOT --actions 20``: made actions of different seeds are run by
``imocap run-all``, each time from nothing: one after the other; by worker processes; and
by a Dask cluster of two workers that share a folder, of which one is killed by signal 9 in the
middle.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import yaml

from imocap_core.io.video import write_h264
from imocap_core.pipeline.make_demo import demo_body, video_id, write_keypoints
from imocap_core.pipeline.source import PROJECT
from imocap_core.synthetic.yoga_clip import LAYOUT, make_yoga_clip, pictures
from tools.dask_cluster import started_cluster

Digests = dict[tuple[str, str], str]
VIDEOS, FRAMES, CRF, STAGES = 2, 40, 20, 9
COMMAND = [sys.executable, "-c", "import sys; from imocap_core.cli import main; sys.exit(main())"]


def run_all(root: Path, names: list[str], words: list[str]) -> subprocess.Popen[bytes]:
    """`imocap run-all` of the actions, begun."""
    line = [*COMMAND, "--root", str(root), "run-all", *names, *words, "--json"]
    output = (root / "run-all.json").open("wb")
    return subprocess.Popen(line, stdout=output, cwd=PROJECT)


def finished(root: Path, process: subprocess.Popen[bytes]) -> Digests:
    """The digests of all results when the command has ended; an action that failed ends this."""
    code, text = process.wait(), (root / "run-all.json").read_text()
    if code:
        raise SystemExit(f"run-all ended with {code}: {text[-2000:]}")
    return {
        (end["action"], stage["stage"]): stage["digest"]
        for end in json.loads(text)["actions"]
        for stage in end["stages"]
    }


def make_action(folder: Path, seed: int) -> None:
    """The first frames of yoga's films and keypoints, of a seed."""
    if (folder / "action.yaml").exists():
        return
    shaped, videos = demo_body(seed), []
    (folder / "videos").mkdir(parents=True, exist_ok=True)
    for index in range(VIDEOS):
        name, clip = video_id(index), make_yoga_clip(seed, index, shaped)
        film = islice(pictures(clip, seed, index, shaped), FRAMES)
        write_h264(folder / "videos" / f"{name}.mp4", film, clip.fps, crf=CRF)
        keypoints = folder / "keypoints" / name
        write_keypoints(keypoints, name, clip)
        for file in sorted(keypoints.iterdir())[FRAMES:]:
            file.unlink()
        files = {"video": f"videos/{name}.mp4", "keypoints": f"keypoints/{name}"}
        videos.append({"id": name, **files, "format": "openpose", "layout": LAYOUT})
    text = yaml.safe_dump({"name": folder.name, "videos": videos}, sort_keys=False)
    (folder / "action.yaml").write_text(text)


def working_folder(root: Path, actions: Path | None = None) -> Path:
    """An empty working folder, with these actions."""
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir(parents=True)
    shutil.copy(PROJECT / "pipeline.yaml", root)
    if actions is not None:
        (root / "actions").symlink_to(actions.resolve())
    return root


def in_this_machine(root: Path, names: list[str], executor: str, workers: int) -> Digests:
    """By the executor `serial` or `processes`."""
    words = ["--executor", executor, "--workers", str(workers)]
    return finished(root, run_all(root, names, words if executor != "serial" else words[:2]))


def on_cluster(root: Path, names: list[str], roots: list[Path]) -> Digests:
    """By two Dask workers, of which the first is killed when a third of the results is there."""
    with started_cluster(roots, {}, replaced=False) as made:
        words = ["--executor", "dask", "--address", made.address]
        command = run_all(root, names, words)
        while command.poll() is None and len(results(roots)) < len(names) * STAGES / 3:
            time.sleep(0.2)
        made.workers[0].send_signal(signal.SIGKILL)
        print(f"    killed a worker after {len(results(roots))} results", flush=True)
        return finished(root, command)


def results(roots: list[Path]) -> set[str]:
    """Names of the results below working folders."""
    return {file.name for root in roots for file in root.glob("artifacts/.cache/*/*.mcap")}


def of_all(digests: Digests) -> str:
    """One digest of all, to compare ways that were not run in one go."""
    text = repr(sorted(digests.items()))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def main() -> None:
    """Run all actions by every executor and compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("root", type=Path)
    parser.add_argument("--actions", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", nargs="*", help="executors")
    given = parser.parse_args()
    actions, names = given.root / "actions", [f"a{seed:02d}" for seed in range(given.actions)]
    for seed, name in enumerate(names):
        make_action(actions / name, seed)

    def fresh(name: str) -> Path:
        return working_folder(given.root / name, actions)

    def shared() -> Digests:
        root = fresh("cluster")
        return on_cluster(root, names, [root, root])

    ways: dict[str, Callable[[], Digests]] = {
        "serial": lambda: in_this_machine(fresh("serial"), names, "serial", 1),
        "processes": lambda: in_this_machine(fresh("processes"), names, "processes", given.workers),
        "dask": shared,
    }
    first: tuple[float, Digests] | None = None
    for name, way in ways.items():
        if given.only and name not in given.only:
            continue
        start = time.monotonic()
        made = way()
        seconds = time.monotonic() - start
        first = first or (seconds, made)
        ratio = first[0] / seconds
        equal = sum(made[key] == digest for key, digest in first[1].items())
        row = f"| {name} | {seconds:.0f} | {ratio:.2f} | {equal} of {len(first[1])} |"
        print(f"{row} {of_all(made)} |", flush=True)


if __name__ == "__main__":
    main()
