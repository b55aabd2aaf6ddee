"""A second look at some pictures of a video, where the person is known to be."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

import numpy as np
from jaxtyping import Float, Int

from imocap_core.adapters.redetection import SecondLook
from imocap_core.detect.detection import MOST_AT_ONCE, Worker, WorkerGroup, with_last
from imocap_core.detect.detectors import Detector
from imocap_core.detect.workers import blazepose_again, blazepose_pose, exchange
from imocap_core.detect.workers.blazepose.looks import KINDS
from imocap_core.io.video import read_rgb_of
from imocap_core.workers import cores

LAYOUT = "blazepose33"  # of what is looked for
SCRIPTS = (blazepose_again, blazepose_pose, exchange)  # so that results depend on their code
WORKER = Path(blazepose_again.__file__)


@dataclass(frozen=True)
class KnownPlaces:
    """Pictures of a video that are to be looked at.

    frames: of the file, each once and in order. xy_px: the points of `LAYOUT` that the person is
    expected to have there.
    """

    video: Path
    frames: Int[np.ndarray, " N"]
    xy_px: Float[np.ndarray, "N K 2"]


def look_again(
    places: Sequence[KnownPlaces],
    detector: Detector,
    python: Path,
    progress: Callable[[float], None],
) -> list[list[SecondLook]]:
    """Looks at all pictures of each video, several videos at a time.

    Args:
        detector: `blazepose`, with its settings; python: its environment's (`set_up`).
        progress: called with the share of the pictures that were looked at.

    WorkFailed when the detector fails, ValueError when a video cannot be read.
    """
    total, count = sum(len(one.frames) for one in places), 0
    lock, workers = Lock(), WorkerGroup()

    def looks(one: KnownPlaces) -> list[SecondLook]:
        nonlocal count
        answers = []
        for look in _looks(one, detector, python, workers):
            answers.append(look)
            with lock:
                count += 1
                progress(count / total)
        return answers

    return workers.results(looks, places, min(len(places), cores(), MOST_AT_ONCE))


def _looks(
    one: KnownPlaces, detector: Detector, python: Path, workers: WorkerGroup
) -> Iterator[SecondLook]:
    numbers = frozenset(int(frame) for frame in one.frames)
    with (
        _saved(one.xy_px) as file,
        Worker(python, WORKER, detector.arguments | {"places": str(file)}, threads=1) as worker,
    ):
        workers.add(worker)
        for (_, picture), is_last in with_last(read_rgb_of(one.video, numbers)):
            answer = worker.detect(picture, is_last)
            places = (np.array(of_kind, float).reshape(-1, 2) for of_kind in answer["limbs"])
            yield SecondLook(
                dict(zip(KINDS, places, strict=True)),
                np.array(answer["body"], float),
                float(answer["presence"]),
            )


@contextmanager
def _saved(xy_px: Float[np.ndarray, "N K 2"]) -> Iterator[Path]:
    """A file of an array, as long as it is needed."""
    with tempfile.TemporaryDirectory(prefix="imocap-places-") as folder:
        file = Path(folder) / "places.npy"
        np.save(file, xy_px)
        yield file
