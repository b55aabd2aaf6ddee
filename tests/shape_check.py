"""Annotations (types, and shapes of arrays) checked in the tests, at the first calls of each test.

A check takes some fifty microseconds. At every call of small functions in inner loops that was a
fifth of the time of the slowest tests, for what the first calls had shown.
"""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Sequence
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype

CALLS = 2  # of each function, in each test

checked = beartype(conf=BeartypeConf(is_pep484_tower=True))  # takes an int where a float is asked
_every_call = jaxtyping.jaxtyped
_test = 0  # number of the test that runs
_calls: dict[int, list[int]] = {}  # test, calls left; of a code, which a function's copies share


def check_annotations(modules: Sequence[str]) -> None:
    """Check what is defined in these modules, which must not have been imported yet."""
    jaxtyping.jaxtyped = _first_calls  # what the hook decorates functions and classes with
    jaxtyping.install_import_hook(modules, f"{__name__}.checked")


def begin_test() -> None:
    """The next calls are the first ones again."""
    global _test
    _test += 1


def _first_calls(fn: Any = None, *, typechecker: Any) -> Any:
    """`jaxtyping.jaxtyped` for the first calls of each test."""
    if fn is None:
        return functools.partial(_first_calls, typechecker=typechecker)
    first_calls = functools.partial(_first_calls, typechecker=typechecker)
    if inspect.isclass(fn):
        if dataclasses.is_dataclass(fn) and "__init__" in vars(fn):
            fn.__init__ = first_calls(fn.__init__)
        return fn
    if isinstance(fn, classmethod | staticmethod):
        return type(fn)(first_calls(fn.__func__))
    if isinstance(fn, property):
        return property(*(f and first_calls(f) for f in (fn.fget, fn.fset, fn.fdel)))
    if not inspect.isfunction(fn):
        return _every_call(fn, typechecker=typechecker)
    if hasattr(fn, "first_calls"):  # by the decorator of its class, too
        return fn
    calls = _calls.setdefault(id(fn.__code__), [-1, 0])
    always: Callable[..., Any] | None = None

    @functools.wraps(fn)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal always  # made at the first call: most functions of a room are not called
        if calls[0] != _test:
            calls[:] = _test, CALLS
        if calls[1] <= 0:
            return fn(*args, **kwargs)
        calls[1] -= 1
        always = always or _every_call(fn, typechecker=typechecker)
        return always(*args, **kwargs)

    call.first_calls = True  # type: ignore[attr-defined]
    return call
