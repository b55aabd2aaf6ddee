"""Several videos through a detector at the same time, with the stand-in for MediaPipe."""

from __future__ import annotations

from pathlib import Path
from threading import Event, Timer

import numpy as np
import pytest

from imocap_core.detect import detection
from imocap_core.detect.detection import Undetected, Worker, WorkerGroup, detect_videos
from imocap_core.detect.detectors import Detector, detector_of
from imocap_core.errors import WorkFailed
from imocap_core.params import DetectParams
from tests.detect.conftest import clip

LENGTHS = (9, 4, 6)


@pytest.fixture(params=[1, 3], ids=["one core", "three cores"])
def many_cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    count: int = request.param
    monkeypatch.setattr(detection, "cores", lambda: count)
    return count


@pytest.fixture
def detector(tmp_path: Path, detector_python: Path) -> Detector:
    return detector_of(DetectParams(detector="mediapipe"), tmp_path)


def videos(folder: Path, nobody_in: int | None = None) -> list[Undetected]:
    return [
        Undetected(
            clip(folder / f"{row}.mp4", [None if row == nobody_in else 20 + t for t in range(n)]),
            folder / "out" / f"{row}.npz",
        )
        for row, n in enumerate(LENGTHS)
    ]


@pytest.mark.usefixtures("many_cores")
def test_every_video_has_its_detections_and_the_share_only_grows(
    tmp_path: Path, detector: Detector, detector_python: Path
) -> None:
    made, shares = videos(tmp_path), list[float]()
    detect_videos(made, detector, detector_python, lambda share, what: shares.append(share))
    assert shares == sorted(shares)
    assert len(shares) == sum(LENGTHS)
    assert np.isclose(shares[-1], 1.0)
    for one, frames in zip(made, LENGTHS, strict=True):
        with np.load(one.file) as arrays:
            assert len(arrays["frames"]) == frames


@pytest.mark.usefixtures("many_cores")
def test_the_others_are_finished_where_one_fails(
    tmp_path: Path, detector: Detector, detector_python: Path
) -> None:
    made = videos(tmp_path, nobody_in=1)
    with pytest.raises(WorkFailed, match=r"1\.mp4: mediapipe 0\.10\.21 found no person"):
        detect_videos(made, detector, detector_python, lambda share, what: None)
    assert [one.file.is_file() for one in made] == [True, False, True]


def test_detectors_that_hang_end_with_an_interrupted_run(
    tmp_path: Path,
    detector: Detector,
    detector_python: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The interrupt reaches the main thread only, as Ctrl-C does."""
    monkeypatch.setattr(detection, "cores", lambda: 3)
    monkeypatch.setenv("FAKE_DIES_AT", "2")
    monkeypatch.setenv("FAKE_HANGS", "1")
    all_hang = Event()
    workers: list[Worker] = []

    class Pool(detection.ThreadPoolExecutor):
        def map(self, work, rows, **more):  # type: ignore[no-untyped-def]
            super().map(work, rows, **more)
            assert all_hang.wait(60)
            raise KeyboardInterrupt

    def progress(share: float, what: str) -> None:
        if share > 0.29:  # two frames of each
            Timer(0.3, all_hang.set).start()

    add = WorkerGroup.add

    def noted(self: WorkerGroup, worker: Worker) -> None:
        workers.append(worker)
        add(self, worker)

    monkeypatch.setattr(detection, "ThreadPoolExecutor", Pool)
    monkeypatch.setattr(WorkerGroup, "add", noted)
    with pytest.raises(KeyboardInterrupt):
        detect_videos(videos(tmp_path), detector, detector_python, progress)
    assert len(workers) == 3
    assert all(worker._process.poll() is not None for worker in workers)
    assert not list(tmp_path.glob("out/*.npz"))
