"""A restricted unpickler, for plain pickles and for joblib's.

joblib's files are pickles in which an array is a small record followed at once by the array's bytes
(one byte states how many bytes of padding come first), so joblib itself is not needed.
"""

from __future__ import annotations

import io
import math
import pickle
import struct
import tokenize
import zipfile
import zlib
from lzma import LZMAError
from typing import Any, ClassVar

from imocap_core.unpickle.containers import CONTAINERS, check_keys, check_size, defaultdict_of
from imocap_core.unpickle.records import (
    ArrayRecord,
    DtypeRecord,
    InertObject,
    JoblibRecord,
    NdarrayClass,
    array_record,
    build,
    from_buffer,
    scalar,
    storage,
    tensor,
)

UNREADABLE: tuple[type[Exception], ...] = (
    *(pickle.UnpicklingError, AttributeError, IndexError, KeyError, TypeError, ValueError),
    *(MemoryError, OverflowError, RecursionError, EOFError, OSError, RuntimeError, SyntaxError),
    *(tokenize.TokenError, AssertionError, struct.error, zlib.error, LZMAError),
    zipfile.BadZipFile,
)
"""What damaged or unsafe pickles, and the compressed files around them, raise when read."""


def load_pickle(content: bytes, inert_modules: tuple[str, ...] = ()) -> Any:
    """What a pickle holds: tensors as numpy arrays, tuples as lists.

    inert_modules: objects of these modules become `InertObject`; every other name is refused.

    Raises one of `UNREADABLE` when the pickle is damaged or would run something.
    """
    value = RestrictedUnpickler(io.BytesIO(content), inert_modules).load()
    check_size(value)
    return build(value)


def _encode(text: Any, encoding: Any) -> bytes:
    """How pickles of protocol 2 write bytes."""
    if not isinstance(text, str) or encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError(f"it would decode bytes as {encoding!r:.20}")
    return text.encode("latin1")


def _no_bytes(*content: Any) -> bytes:
    """How pickles of protocol 2 write no bytes at all."""
    if content:
        raise pickle.UnpicklingError("it would make bytes of something")
    return b""


def _inert(kind: Any, *_unused: Any) -> InertObject:
    """copyreg's reconstructor, for inert objects only."""
    if not (isinstance(kind, type) and issubclass(kind, InertObject)):
        raise pickle.UnpicklingError(f"it would rebuild a {kind!r:.20}")
    return InertObject()


_ALLOWED: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): NdarrayClass,
    ("numpy", "dtype"): DtypeRecord,
    ("_codecs", "encode"): _encode,
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): JoblibRecord,
    ("collections", "OrderedDict"): CONTAINERS["dict"],
    ("collections", "defaultdict"): defaultdict_of,
    ("torch._utils", "_rebuild_tensor_v2"): tensor,
    ("torch.storage", "_load_from_bytes"): storage,
    ("copyreg", "_reconstructor"): _inert,
    ("copy_reg", "_reconstructor"): _inert,
}
for _core in ("numpy.core", "numpy._core"):
    _ALLOWED[f"{_core}.multiarray", "_reconstruct"] = array_record
    _ALLOWED[f"{_core}.multiarray", "scalar"] = scalar
    _ALLOWED[f"{_core}.numeric", "_frombuffer"] = from_buffer
for _module in ("builtins", "__builtin__"):
    _ALLOWED[_module, "bytes"] = _no_bytes
    for _kind in (list, tuple, object):
        _ALLOWED[_module, _kind.__name__] = _kind
    _ALLOWED |= {(_module, name): make for name, make in CONTAINERS.items()}


def _must_be(container: Any, kind: type) -> None:
    if not isinstance(container, kind):
        raise pickle.UnpicklingError(f"it would set items of a {type(container).__name__}")


_LOAD: dict[int, Any] = pickle._Unpickler.dispatch  # Python's way with each code of a pickle


class RestrictedUnpickler(pickle._Unpickler):
    """Python's own unpickler (it reads no byte too many), with nothing to call but `_ALLOWED`,
    and nothing to change but records."""

    def __init__(self, stream: io.BytesIO, inert_modules: tuple[str, ...] = ()) -> None:
        super().__init__(stream, encoding="latin1")
        self._raw, self._inert_modules = stream, inert_modules

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _ALLOWED:
            return _ALLOWED[module, name]
        if any(f"{module}.".startswith(f"{inert}.") for inert in self._inert_modules):
            return InertObject
        raise pickle.UnpicklingError(f"it names {module}.{name}, which is not allowed here")

    def load_build(self) -> None:
        stack: list[Any] = self.stack  # type: ignore[attr-defined]
        state, record = stack.pop(), stack[-1]
        if not isinstance(record, (ArrayRecord, DtypeRecord, JoblibRecord, InertObject)):
            raise pickle.UnpicklingError(f"it would change a {type(record).__name__}")
        record.restore(state)
        if isinstance(record, JoblibRecord):
            self._read_content(record)

    def _read_content(self, record: JoblibRecord) -> None:
        """The array that follows its record: another pickle, or bytes after some padding."""
        dtype = record.state["dtype"].dtype
        if dtype.hasobject:
            record.content = RestrictedUnpickler(self._raw, self._inert_modules).load()
            return
        if record.state.get("numpy_array_alignment_bytes") is not None:
            self._raw.read(self._raw.read(1)[0])
        shape = record.state.get("shape")
        count = math.prod(shape) if isinstance(shape, tuple) else 0
        record.content = self._raw.read(max(0, count) * dtype.itemsize)

    def load_bytearray8(self) -> None:
        """As many bytes as it states, if they are there: room is made for no others."""
        size = int.from_bytes(self.read(8), "little")  # type: ignore[attr-defined]
        if size > self._raw.getbuffer().nbytes:
            raise pickle.UnpicklingError(f"it contains {size} bytes, which are not there")
        self.append(bytearray(self.read(size)))  # type: ignore[attr-defined]

    def load_setitems(self) -> None:
        """Into a dictionary, by keys that are cheap to compare."""
        marked: list[list[Any]] = self.metastack  # type: ignore[attr-defined]
        items: list[Any] = self.stack  # type: ignore[attr-defined]
        check_keys(items[::2])
        _must_be(marked[-1][-1], dict)
        _LOAD[pickle.SETITEMS[0]](self)

    def load_setitem(self) -> None:
        """The same for one key."""
        stack: list[Any] = self.stack  # type: ignore[attr-defined]
        check_keys(stack[-2:-1])
        _must_be(stack[-3], dict)
        _LOAD[pickle.SETITEM[0]](self)

    def load_dict(self) -> None:
        """A dictionary of protocol 0."""
        check_keys(self.stack[::2])  # type: ignore[attr-defined]
        _LOAD[pickle.DICT[0]](self)

    def load_additems(self) -> None:
        """Into a set."""
        check_keys(self.stack)  # type: ignore[attr-defined]
        _LOAD[pickle.ADDITEMS[0]](self)

    def load_frozenset(self) -> None:
        """A set that does not change."""
        check_keys(self.stack)  # type: ignore[attr-defined]
        _LOAD[pickle.FROZENSET[0]](self)

    dispatch: ClassVar[dict[int, Any]] = {
        **pickle._Unpickler.dispatch,
        pickle.BUILD[0]: load_build,
        pickle.BYTEARRAY8[0]: load_bytearray8,
        pickle.SETITEMS[0]: load_setitems,
        pickle.SETITEM[0]: load_setitem,
        pickle.DICT[0]: load_dict,
        pickle.ADDITEMS[0]: load_additems,
        pickle.FROZENSET[0]: load_frozenset,
    }
