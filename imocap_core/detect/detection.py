"""One video through a detector, into one file of the cache."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from imocap_core.artifacts.shared_results import fetch_detections, share_file
from imocap_core.artifacts.store import Store
from imocap_core.detect.detectors import Detector
from imocap_core.detect.process import Worker
from imocap_core.detect.results import frames_with_people
from imocap_core.errors import WorkFailed
from imocap_core.io.prefetch import prefetch
from imocap_core.io.video import RgbPicture, probe, read_rgb
from imocap_core.pipeline.content import content_digest
from imocap_core.pipeline.unchanged import unchanged
from imocap_core.whole_files import publish_once, writer

FOLDER = "detections"
Progress = Callable[[float, str], None]
Item = TypeVar("Item")


def detections_file(store: Store, video: Path, detector: Detector) -> Path:
    """The file of a video's detections (absolute, it need not exist): its name is a digest of all
    that they depend on."""
    key = detector.key(content_digest(video), [content_digest(model) for model in detector.models])
    return store.folder.resolve() / ".cache" / FOLDER / f"{key}.npz"


@contextmanager
def decoded_ahead(video: Path) -> Iterator[Iterator[tuple[int, RgbPicture]]]:
    """A video's numbered pictures, decoded while others are looked at."""
    pictures = prefetch(read_rgb(video))
    try:
        yield pictures
    finally:
        if isinstance(pictures, Generator):
            pictures.close()


def with_last(items: Iterable[Item]) -> Iterator[tuple[Item, bool]]:
    """Each with whether it is the last."""
    waiting: list[Item] = []
    for item in items:
        if waiting:
            yield waiting.pop(), False
        waiting.append(item)
    for item in waiting:
        yield item, True


def fetch_detections_of(store: Store, file: Path) -> bool:
    """Whether a video's detections are here, or can be fetched from the shared store."""
    if file.is_file():
        return True
    return store.shared is not None and fetch_detections(store.shared, file)


def share_detections(store: Store, files: Iterable[Path]) -> None:
    """Publish the detections of videos in the shared store, where there is one."""
    for file in files:
        if store.shared is not None:
            share_file(store.shared, FOLDER, file)


def detect_video(
    video: Path,
    file: Path,
    detector: Detector,
    python: Path,
    progress: Progress,
    *,
    threads: int | None = None,
    started: Callable[[Worker], None] = lambda worker: None,
) -> None:
    """Write the detections of all frames of a video into `file`; whole or not at all.

    Another action's run may detect the same video meanwhile: the first file stays.

    `progress` is called with the share of the work and a sentence. WorkFailed when the detector
    fails or finds no person, ValueError when the video cannot be read.

    Args:
        threads: of the detector's process; started: is called with it.
    """
    count = max(probe(video).frame_count, 1)
    answers = []
    with (
        unchanged({"video": video}),
        Worker(python, detector.worker, detector.arguments, threads) as worker,
        decoded_ahead(video) as pictures,
    ):
        started(worker)
        for (number, picture), is_last in with_last(pictures):
            answers.append(worker.detect(picture, is_last))
            progress(min((number + 1) / count, 1.0), f"{video.name}: frame {number + 1} of {count}")
    arrays: dict[str, Any] = detector.arrays(answers)
    if not frames_with_people(arrays):
        raise WorkFailed(
            f"{video}: {detector.version} found no person in {len(answers)} frames; try another "
            "detector (`imocap params detect` lists them), or give keypoints from elsewhere"
        )
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".detect-{writer()}", dir=file.parent) as folder:
        draft = Path(folder) / file.name
        np.savez_compressed(draft, **arrays)
        publish_once(draft, file)
