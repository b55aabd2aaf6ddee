"""A detector at work in a process of its own: a picture in, its answer out."""

from __future__ import annotations

import json
import struct
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imocap_core.errors import WorkFailed

HEAD = struct.Struct("<III")  # as stages/detect/workers say


class Worker:
    """A script in another Python; WorkFailed says why it could not start or go on."""

    def __init__(self, python: Path, script: Path, settings: dict[str, Any]) -> None:
        self._said = tempfile.TemporaryFile()  # noqa: SIM115
        self._what = f"{script.stem} in {python}"
        try:
            self._process = subprocess.Popen(
                [str(python), str(script), json.dumps(settings)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._said,
            )
        except OSError as error:
            self._said.close()
            raise WorkFailed(f"cannot start {self._what}: {error.strerror}") from None

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
            self._process.kill()
        self._end()

    def _end(self) -> None:
        """Let it finish, and close what led to it."""
        for stream in (self._process.stdin, self._process.stdout):
            assert stream is not None
            with suppress(OSError):
                stream.close()
        self._process.wait()
        self._said.close()

    def ask(self, frame: int, picture: NDArray[np.uint8]) -> dict[str, Any]:
        """The answer to one picture (height, width, 3) RGB."""
        assert self._process.stdin is not None
        with suppress(OSError):  # it is gone: why is told below
            self._process.stdin.write(HEAD.pack(frame, *picture.shape[:2]))
            self._process.stdin.write(np.ascontiguousarray(picture).tobytes())
            self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        try:
            answer = json.loads(line)
        except ValueError:
            why = self._last_words()
            raise WorkFailed(f"{self._what} ended without an answer: {why}") from None
        if not isinstance(answer, dict) or "fault" in answer:
            said = answer["fault"] if isinstance(answer, dict) else line.decode(errors="replace")
            raise WorkFailed(f"{self._what} cannot work: {said}")
        return answer

    def _last_words(self) -> str:
        """The last line it wrote for people."""
        self._process.wait()
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").strip().splitlines()
        return lines[-1][:300] if lines else f"exit code {self._process.returncode}"
