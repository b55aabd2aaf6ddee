"""Videos through a detector, each in a separate process, into files of the cache.

One picture at a time hardly gains from a second thread, so the cores are shared among videos.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Lock
from typing import Any, TypeVar

import numpy as np
from jaxtyping import UInt8

from imocap_core.artifacts.file_memory import exclusive
from imocap_core.artifacts.store import Store
from imocap_core.detect.detectors import Detector, frames_with_people
from imocap_core.detect.environment import FOLDER as ENVIRONMENT_FOLDER
from imocap_core.detect.environment import (
    environment_folder,
    fetch_networks,
    is_available,
    is_present,
    python_for,
)
from imocap_core.errors import ImocapError, WorkFailed
from imocap_core.files import publish_once, writer
from imocap_core.io.frame_access import prefetch
from imocap_core.io.video import probe, read_rgb
from imocap_core.pipeline.source import content_digest, unchanged
from imocap_core.workers import cores


def set_up(detector: Detector, announce: Callable[[str], None]) -> Path:
    """The Python that the detector runs in; what is missing is made or fetched, and `announce` is
    called before each slow step. WorkFailed when that fails.

    Of several processes one makes it, and the others wait.
    """
    if is_set_up(detector):
        return _complete(detector, announce)
    lock = environment_folder().with_name(f"{ENVIRONMENT_FOLDER}.lock")
    with exclusive(lock, lambda: announce("another process makes the detector's environment")):
        return _complete(detector, announce)


def _complete(detector: Detector, announce: Callable[[str], None]) -> Path:
    python = python_for(detector.packages, announce)
    fetch_networks(list(detector.networks.values()), announce)
    return python


def is_set_up(detector: Detector) -> bool:
    """Whether `set_up` would make and fetch nothing."""
    return is_available(detector.packages) and all(map(is_present, detector.networks.values()))


ANSWER_S = 300.0  # the longest wait for one answer: loading a model on a busy machine takes 60
END_S = 30.0
HEAD = struct.Struct("<III")  # is it the last, height, width: the protocol of detect/workers


class Worker:
    """A script of detect/workers in another Python; WorkFailed when it cannot start or go on."""

    def __init__(
        self, python: Path, script: Path, settings: dict[str, Any], threads: int | None = None
    ) -> None:
        """threads: that it computes with; None: as many as the script chooses."""
        of_threads = {} if threads is None else {"OMP_NUM_THREADS": str(threads)}
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115
        number, name = tempfile.mkstemp(prefix="imocap-picture-")
        self._picture, self._picture_file = os.fdopen(number, "wb"), Path(name)
        self._name = f"{script.stem} in {python}"
        try:
            self._process = subprocess.Popen(
                [str(python), str(script), json.dumps(settings), name],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                env=os.environ | of_threads,
            )
        except OSError as error:
            self._close()
            raise WorkFailed(f"cannot start {self._name}: {error.strerror}") from None

    def __enter__(self) -> Worker:
        try:
            self._answer()
        except WorkFailed:
            self._end()
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if kind is not None:
            self.kill()
        self._end()

    def kill(self) -> None:
        """End it at once; who waits for its answer gets `WorkFailed`."""
        self._process.kill()

    def _end(self) -> None:
        """Close the pipes to it, and wait for its end."""
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            with suppress(OSError):
                stream.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._close()

    def _close(self) -> None:
        """Close the files that are shared with it."""
        self._errors.close()
        with suppress(OSError):  # what could not be written was said
            self._picture.close()
        self._picture_file.unlink(missing_ok=True)

    def detect(self, picture: UInt8[np.ndarray, "H W 3"], is_last: bool) -> dict[str, Any]:
        """The answer to one picture, RGB; WorkFailed when the process fails or ends."""
        try:
            self._picture.seek(0)
            self._picture.write(np.ascontiguousarray(picture).data.cast("B"))
            self._picture.flush()
        except OSError as error:
            raise WorkFailed(f"{self._picture_file}: cannot be written: {error.strerror}") from None
        return self._answer(HEAD.pack(is_last, *picture.shape[:2]))

    def _answer(self, question: bytes = b"") -> dict[str, Any]:
        """The answer to a question; WorkFailed when none comes in time."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        hung = threading.Event()

        def end() -> None:
            hung.set()
            self._process.kill()

        watch = threading.Timer(ANSWER_S, end)
        watch.start()
        try:
            with suppress(OSError):  # it has ended: below is said why
                self._process.stdin.write(question)
                self._process.stdin.flush()
            line = self._process.stdout.readline()
        finally:
            watch.cancel()
        if hung.is_set():
            raise WorkFailed(f"{self._name} gave no answer for {ANSWER_S:.0f} s and was ended")
        try:
            answer = json.loads(line)
        except ValueError:
            why = self._last_line()
            raise WorkFailed(f"{self._name} ended without an answer: {why}") from None
        if not isinstance(answer, dict) or "fault" in answer:
            fault = answer["fault"] if isinstance(answer, dict) else line.decode(errors="replace")
            raise WorkFailed(f"{self._name} failed: {fault}")
        return answer

    def _last_line(self) -> str:
        """The last line of its standard error, or its exit code."""
        self._process.wait()
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1][:300] if lines else f"exit code {self._process.returncode}"


Task = TypeVar("Task")
Result = TypeVar("Result")


@dataclass
class WorkerGroup:
    """They can be ended together; one that starts later ends at once."""

    stopped: Event = field(default_factory=Event)
    working: list[Worker] = field(default_factory=list)

    def add(self, worker: Worker) -> None:
        """One has started."""
        self.working.append(worker)
        if self.stopped.is_set():
            worker.kill()

    def results(
        self, call: Callable[[Task], Result], tasks: Iterable[Task], at_once: int
    ) -> list[Result]:
        """A call's results for all tasks, so many at once; the first error, or Ctrl-C, ends all."""
        with ThreadPoolExecutor(at_once) as pool:
            try:
                return list(pool.map(call, tasks))
            except BaseException:
                self.stop()
                raise

    def stop(self) -> None:
        """End all of them."""
        self.stopped.set()
        for worker in self.working:
            worker.kill()


FOLDER = "detections"
Progress = Callable[[float, str], None]
Item = TypeVar("Item")


def detections_file(store: Store, video: Path, detector: Detector) -> Path:
    """The file of a video's detections (absolute, it need not exist): its name is a digest of all
    that they depend on."""
    key = detector.key(content_digest(video), [content_digest(model) for model in detector.models])
    return store.folder.resolve() / ".cache" / FOLDER / f"{key}.npz"


def with_last(items: Iterable[Item]) -> Iterable[tuple[Item, bool]]:
    """Each with whether it is the last."""
    waiting: list[Item] = []
    for item in items:
        if waiting:
            yield waiting.pop(), False
        waiting.append(item)
    for item in waiting:
        yield item, True


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
        closing(prefetch(read_rgb(video))) as pictures,
    ):
        started(worker)
        for (number, picture), is_last in with_last(pictures):
            answers.append(worker.detect(picture, is_last))
            progress(min((number + 1) / count, 1.0), f"{video.name}: frame {number + 1} of {count}")
    arrays: dict[str, Any] = detector.arrays(answers)
    if not frames_with_people(arrays):
        raise WorkFailed(
            f"{video}: {detector.version} found no person in {len(answers)} frames; try another "
            "detector (`imocap params detect` lists them), give keypoints from elsewhere, or "
            "remove the video"
        )
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".detect-{writer()}", dir=file.parent) as folder:
        draft = Path(folder) / file.name
        np.savez_compressed(draft, **arrays)
        publish_once(draft, file)


MOST_AT_ONCE = 8  # processes of 200 MB, and as much again for the last pictures of each


def detect_videos(
    videos: Mapping[Path, Path], detector: Detector, python: Path, progress: Progress
) -> list[ValueError]:
    """Detect people in all of the videos; why some cannot be decoded to their end.

    Where the detector fails, the other videos are finished, and then the first failure is raised.
    Ctrl-C ends all.

    Args:
        videos: by the files that their detections go into.
        progress: called with the share of all the work, and a sentence about one video.
    """
    at_once = min(len(videos), cores(), MOST_AT_ONCE)
    threads = cores() // at_once if at_once > 1 else None
    shares, lock, workers = dict.fromkeys(videos, 0.0), Lock(), WorkerGroup()

    def detect(file: Path) -> ImocapError | ValueError | None:
        def one_progress(share: float, what: str) -> None:
            with lock:
                shares[file] = share
                progress(sum(shares.values()) / len(shares), what)

        try:
            detect_video(
                videos[file], file, detector, python, one_progress,
                threads=threads, started=workers.add,
            )  # fmt: skip
        except (ImocapError, ValueError) as error:
            return error
        return None

    alone = at_once == 1
    faults = [*map(detect, videos)] if alone else workers.results(detect, videos, at_once)
    for fault in faults:
        if isinstance(fault, ImocapError):
            raise fault
    return [fault for fault in faults if isinstance(fault, ValueError)]
