"""Several videos through a detector at the same time, each in a process of its own.

One picture at a time hardly gains from a second thread, so the cores are shared among videos.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock

from imocap_core.detect.detection import Progress, detect_video
from imocap_core.detect.detectors import Detector
from imocap_core.detect.worker_group import WorkerGroup
from imocap_core.errors import ImocapError
from imocap_core.workers import cores

MOST_AT_ONCE = 8  # processes of 200 MB, and as much again for the last pictures of each


@dataclass(frozen=True)
class Undetected:
    """A video, and the file that its detections go into."""

    video: Path
    file: Path


def detect_videos(
    videos: Sequence[Undetected], detector: Detector, python: Path, progress: Progress
) -> list[ValueError]:
    """Detect people in all of the videos; why some cannot be decoded to their end.

    Where the detector fails, the other videos are finished, and then the first failure is raised.
    Ctrl-C ends all.

    Args:
        progress: called with the share of all the work, and a sentence about one video.
    """
    at_once = min(len(videos), cores(), MOST_AT_ONCE)
    threads = cores() // at_once if at_once > 1 else None
    shares, lock, workers = [0.0] * len(videos), Lock(), WorkerGroup()

    def detect(row: int) -> ImocapError | ValueError | None:
        def one_progress(share: float, what: str) -> None:
            with lock:
                shares[row] = share
                progress(sum(shares) / len(shares), what)

        one = videos[row]
        try:
            detect_video(
                one.video, one.file, detector, python, one_progress,
                threads=threads, started=workers.add,
            )  # fmt: skip
        except (ImocapError, ValueError) as error:
            return error
        return None

    if at_once == 1:
        faults = [detect(row) for row in range(len(videos))]
    else:
        faults = workers.results(detect, range(len(videos)), at_once)
    for fault in faults:
        if isinstance(fault, ImocapError):
            raise fault
    return [fault for fault in faults if isinstance(fault, ValueError)]
