"""A detector in a separate process: a picture in, its answer out."""

from __future__ import annotations

import json
import os
import struct
import subprocess
import tempfile
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from imocap_core.errors import WorkFailed

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
