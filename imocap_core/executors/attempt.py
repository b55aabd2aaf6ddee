"""One attempt at a task, in the process that carries it out."""

from __future__ import annotations

import time

from imocap_core.errors import ImocapError, program_fault, system_fault
from imocap_core.executors.task import Ended, Report, Task


def attempt(task: Task, report: Report) -> Ended:
    """Carry out a task; every error becomes a sentence.

    An interrupt by the user (Ctrl-C, SIGTERM) is none of the task's, and is raised.
    """
    began = time.perf_counter()

    def ended(fault: str, lost: bool = False) -> Ended:
        return Ended(task, time.perf_counter() - began, None, fault, lost)

    try:
        result = task.work(report, *task.arguments)
    except ImocapError as error:
        if isinstance(error.__context__, KeyboardInterrupt):
            raise
        return ended(str(error), _is_passing(error))
    except (OSError, MemoryError) as error:
        return ended(system_fault(error), _is_passing(error))
    except Exception as error:
        return ended(program_fault(error))
    return Ended(task, time.perf_counter() - began, result)


def _is_passing(error: BaseException) -> bool:
    """Whether an error may not come again: memory that others use now, a store that is not
    reachable for a moment."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, (MemoryError, ConnectionError, TimeoutError)):
            return True
        cause = cause.__cause__
    return False
