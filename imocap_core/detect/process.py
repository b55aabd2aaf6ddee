"""A detector in a separate process: a picture in, its answer out."""

from __future__ import annotations

import importlib
import json
import os
import struct
import subprocess
import tempfile
import threading
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import UInt8

from imocap_core.errors import WorkFailed

ANSWER_S = 300.0  # the longest wait for one answer: loading a model on a busy machine takes 60
END_S = 30.0
PIPE_BYTES = 1 << 20
HEAD = struct.Struct("<III")  # is it the last, height, width: the protocol of detect/workers


class Worker:
    """A script of detect/workers in another Python; WorkFailed when it cannot start or go on."""

    def __init__(
        self, python: Path, script: Path, settings: dict[str, Any], threads: int | None = None
    ) -> None:
        """threads: that it computes with; None: as many as the script chooses."""
        of_threads = {} if threads is None else {"OMP_NUM_THREADS": str(threads)}
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115
        self._name = f"{script.stem} in {python}"
        try:
            self._process = subprocess.Popen(
                [str(python), str(script), json.dumps(settings)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                env=os.environ | of_threads,
            )
        except OSError as error:
            self._errors.close()
            raise WorkFailed(f"cannot start {self._name}: {error.strerror}") from None
        assert self._process.stdin is not None
        _widen(self._process.stdin.fileno())

    def __enter__(self) -> Worker:
        try:
            self._answer()
        except WorkFailed:
            self._end()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
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
        self._errors.close()

    def detect(self, picture: UInt8[np.ndarray, "H W 3"], is_last: bool) -> dict[str, Any]:
        """The answer to one picture, RGB; WorkFailed when the process fails or ends."""
        head = HEAD.pack(is_last, *picture.shape[:2])
        return self._answer(head, np.ascontiguousarray(picture).data.cast("B"))

    def _answer(self, *question: bytes | memoryview) -> dict[str, Any]:
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
                for part in question:
                    self._process.stdin.write(part)
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


def _widen(pipe: int) -> None:
    """Let more of a picture into a pipe at a time, where the system lets us."""
    with suppress(ImportError, AttributeError, OSError):
        fcntl = importlib.import_module("fcntl")
        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
