"""The command line: `imocap`, `python -m stages`, and every stage script on its own."""

from __future__ import annotations

import io
import sys
import traceback
from collections.abc import Sequence

from imocap_core.errors import ImocapError, Stopped, WrongUse, program_fault, system_fault
from imocap_core.process import stopped_by_signals

GLOBAL_WITH_VALUE, GLOBAL_FLAGS = ("--root",), ("--traceback", "--allow-scripts")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command: exit code 0 done, 1 the work failed, 2 wrong use, 130 stopped by Ctrl-C.

    An error is one sentence on the standard error, not a traceback. `arguments` (by default none)
    go before those of the process.
    """
    from imocap_core.cli.app import command_line

    # what the encoding lacks becomes a question mark, after hours of work too
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    everywhere, rest = hoisted([*(arguments or []), *sys.argv[1:]])
    words = everywhere + rest
    try:
        with stopped_by_signals():
            command_line(rest[0] if rest else None)(args=words, prog_name="imocap")
    except Stopped as stop:
        sys.stderr.write("imocap: stopped; finished stages are stored, run again to continue\n")
        return stop.exit_code
    except SystemExit as done:
        return done.code if isinstance(done.code, int) else 0
    except Exception as error:
        if "--traceback" in words:
            traceback.print_exc()
        sys.stderr.write(f"imocap: {_sentence(error)}\n")
        return 2 if isinstance(error, WrongUse) else 1
    return 0


def stage_main(stage: str) -> int:
    """`python -m stages.<stage> ACTION [options]`: the same as `imocap stage <stage>`."""
    return main(["stage", stage])


def _sentence(error: Exception) -> str:
    if isinstance(error, ImocapError):
        return str(error)
    if isinstance(error, (OSError, MemoryError)):
        return system_fault(error)
    return program_fault(error)


def hoisted(words: list[str]) -> tuple[list[str], list[str]]:
    """The options of all commands, wherever they are given, and the rest: first the command."""
    front: list[str] = []
    rest: list[str] = []
    waiting = iter(words)
    for word in waiting:
        if word == "--":
            rest += [word, *waiting]
        elif word in GLOBAL_WITH_VALUE:
            front += [word, *([value] if (value := next(waiting, None)) is not None else [])]
        elif word in GLOBAL_FLAGS or word.startswith(tuple(f"{g}=" for g in GLOBAL_WITH_VALUE)):
            front.append(word)
        else:
            rest.append(word)
    return front, rest
