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
    if inspect.isclass(fn) and dataclasses.is_dataclass(fn):
        plain = fn.__init__
        _every_call(fn, typechecker=typechecker)
        if fn.__init__ is not plain:
            fn.__init__ = _sampled(plain, fn.__init__)
        return fn
    if not inspect.isfunction(fn):
        return _every_call(fn, typechecker=typechecker)
    always: Callable[..., Any] | None = None

    def checked_call(*args: Any, **kwargs: Any) -> Any:
        nonlocal always  # made at the first call: most functions of a room are not called
        always = always or _every_call(fn, typechecker=typechecker)
        return always(*args, **kwargs)

    return _sampled(fn, checked_call)


def _sampled(plain: Callable[..., Any], always: Callable[..., Any]) -> Callable[..., Any]:
    test, left = -1, 0

    @functools.wraps(plain)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal test, left
        if test != _test:
            test, left = _test, CALLS
        if left > 0:
            left -= 1
            return always(*args, **kwargs)
        return plain(*args, **kwargs)

    return call
