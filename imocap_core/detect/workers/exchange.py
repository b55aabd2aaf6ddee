"""How a worker talks with the program: pictures come in, one answer a picture goes out.

Of each picture a head comes through the standard input; its bytes, 3 a pixel, lie in a file that
both have open, as a pipe would take ten times as long for them.

A worker is a script in an environment of its own, where imocap is not installed; this file lies
beside it.
"""

from __future__ import annotations

import importlib
import json
import os
import struct
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

HEAD = struct.Struct("<III")  # of a picture: 1 if it is the last, height, width
Detect = Callable[[Any, bool], dict[str, Any]]
WATCH_S = 1.0  # between looks at whether the program is still there


def serve(make: Callable[[dict[str, Any]], Detect]) -> int:
    """Answer every picture; 1 after writing why the detector can't be made.

    Args:
        make: the detector of some settings, a function of one picture (H, W, 3), and of whether it
            is the last. The program's arguments are the settings in JSON and the pictures' file,
            which is removed: nothing of it stays when both are gone.
    """
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    settings, file = json.loads(sys.argv[1]), sys.argv[2]
    pictures = os.fdopen(os.open(file, os.O_RDONLY | getattr(os, "O_BINARY", 0)), "rb", buffering=0)
    with suppress(OSError):  # where an open file cannot be removed, the program does it later
        os.remove(file)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # so that no library prints into the answers

    def answer(message: dict[str, Any]) -> None:
        answers.write(json.dumps(message) + "\n")
        answers.flush()

    try:
        numpy = importlib.import_module("numpy")
        detect = make(settings)
    except Exception as error:
        answer({"fault": f"{type(error).__name__}: {error}"})
        return 1
    answer({"ready": True})
    while len(head := sys.stdin.buffer.read(HEAD.size)) == HEAD.size:
        is_last, height, width = HEAD.unpack(head)
        picture = numpy.empty((height, width, 3), numpy.uint8)
        pictures.seek(0)
        if pictures.readinto(memoryview(picture).cast("B")) < picture.nbytes:
            break
        answer(detect(picture, bool(is_last)))
    return 0


def _end_with(program: int) -> None:
    """End this process when the program is gone, also while a picture is looked at."""
    while os.getppid() == program:
        time.sleep(WATCH_S)
    os._exit(1)
