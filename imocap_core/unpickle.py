"""Pickles read without running anything that is in them: arrays, tensors and Python's containers.

A pickle may name any function, `os.system` included, and numpy's own way of restoring an array
believes what a pickle states about its form. Here every name is refused but those of arrays and
tensors, whose statements become plain records; `build` makes arrays of them with numpy's checked
functions. The rooms that read files (`body`, `io`) put their own sentence around the errors.

Containers are read within limits: keys that are cheap to compare, and shared parts counted, since a
hundred bytes can describe a tree of billions. joblib's files are pickles in which an array is a
small record followed at once by its bytes (one byte states the padding before them).
"""

from __future__ import annotations

import io
import math
import pickle
import re
import struct
import tokenize
import zipfile
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable
from lzma import LZMAError
from typing import Any, ClassVar

import numpy as np
import torch

from imocap_core.limits import MAX_ELEMENTS

PLAIN = (str, bytes, int, float, complex, bool, type(None))


def check_keys(keys: Iterable[Any]) -> None:
    """UnpicklingError unless these are plain values, or tuples of them."""
    for key in keys:
        parts = key if isinstance(key, tuple) else (key,)
        if not all(isinstance(part, PLAIN) for part in parts):
            raise pickle.UnpicklingError("it contains keys that are no words or numbers")


def _size(value: Any, sizes: dict[int, int], above: set[int]) -> int:
    if not isinstance(value, (list, tuple, dict, ArrayRecord, JoblibRecord)):
        return 1
    if id(value) in above:
        raise pickle.UnpicklingError("it contains itself")
    if id(value) not in sizes:
        above.add(id(value))
        sizes[id(value)] = 1 + sum(_size(part, sizes, above) for part in _parts(value))
        above.remove(id(value))
        if sizes[id(value)] > MAX_ELEMENTS:
            raise pickle.UnpicklingError("it contains more parts than can be read")
    return sizes[id(value)]


def _parts(value: Any) -> Iterable[Any]:
    if isinstance(value, ArrayRecord):
        return value.state
    if isinstance(value, JoblibRecord):
        return (value.content,)
    return value.values() if isinstance(value, dict) else value


def _dict(*content: Any) -> dict[Any, Any]:
    pairs = [list(pair) for pair in content[0]] if content else []
    check_keys(pair[0] for pair in pairs)
    return dict(pairs)


def _set(content: Any = ()) -> set[Any]:
    check_keys(content)
    return set(content)


def _bytearray(*content: Any) -> bytes:
    """As protocols below 5 write it: of words; a size alone would make room for that many."""
    if content and not isinstance(content[0], (bytes, str)):
        raise pickle.UnpicklingError("it would make a bytearray of a number")
    first = content[0] if content else b""
    return first.encode("latin1") if isinstance(first, str) else first


def defaultdict_of(*arguments: Any) -> defaultdict[Any, Any]:
    """Without what it would make for a missing key."""
    return defaultdict(None)


CONTAINERS: dict[str, Callable[..., Any]] = {"dict": _dict, "set": _set, "bytearray": _bytearray}


_CODE = re.compile(r"[biufcSUO]\d{0,9}|\?")


class NdarrayClass:
    """Stands for the class numpy.ndarray, which is named but never called."""

    def __init__(self, *arguments: object) -> None:
        raise pickle.UnpicklingError("it would make an array by itself")


class DtypeRecord:
    """The type of an array's numbers: a letter, a size, an order of bytes."""

    def __init__(self, code: Any = None, *_unused: object) -> None:
        if not isinstance(code, str) or not _CODE.fullmatch(code):
            raise pickle.UnpicklingError(f"it contains an array of unknown numbers {code!r:.20}")
        self.code, self.order = code, "="

    def restore(self, state: Any) -> None:
        """As numpy pickles it: (version, order, subarray, names, fields, ...)."""
        valid = isinstance(state, tuple) and len(state) >= 5 and state[1] in ("<", ">", "|", "=")
        if not valid or any(part is not None for part in state[2:5]):
            raise pickle.UnpicklingError("it contains an array of records")
        self.order = state[1]

    @property
    def dtype(self) -> np.dtype[Any]:
        """numpy's."""
        return np.dtype(self.order + self.code)


class ArrayRecord:
    """An array as numpy pickles it: (version, shape, dtype, Fortran order, bytes or list)."""

    state: tuple[Any, ...] = ()

    def restore(self, state: Any) -> None:
        """Stored as it is."""
        if not isinstance(state, tuple) or len(state) != 5:
            raise pickle.UnpicklingError("it contains an array that is not complete")
        self.state = state


class JoblibRecord:
    """joblib's record before an array's bytes, and these bytes."""

    def __init__(self) -> None:
        self.state: dict[str, Any] = {}
        self.content: Any = b""

    def restore(self, state: Any) -> None:
        """Its attributes: shape, order, dtype, whether the bytes are aligned."""
        if not isinstance(state, dict) or not isinstance(state.get("dtype"), DtypeRecord):
            raise pickle.UnpicklingError("it contains an array that is not complete")
        self.state = state


def array_record(*_unused: object) -> ArrayRecord:
    """numpy's _reconstruct."""
    return ArrayRecord()


def from_buffer(buffer: Any, dtype: Any, shape: Any, order: Any) -> np.ndarray:
    """How pickles of protocol 5 write arrays."""
    return _from_bytes(buffer, dtype, shape, order == "F")


def scalar(dtype: Any, content: Any = b"") -> Any:
    """A numpy number, as Python's: it may be a dictionary's key, as ids from np.unique are."""
    return _from_bytes(content, dtype, (1,), False)[0].item()


def storage(content: Any) -> Any:
    """The numbers of a torch tensor inside a pickle: a torch file of its own."""
    return torch.load(io.BytesIO(bytes(content)), map_location="cpu", weights_only=True)


def tensor(numbers: Any, offset: Any, size: Any, stride: Any, *_unused: object) -> np.ndarray:
    """A torch tensor as a numpy array: a view of its storage, within it."""
    if not isinstance(numbers, torch.TypedStorage):
        raise pickle.UnpicklingError("it contains a tensor without numbers")
    flat = torch.tensor([], dtype=numbers.dtype).set_(numbers)
    steps = [_count(step) for step in stride]
    last = _count(offset) + sum(max(_count(n) - 1, 0) * s for n, s in zip(size, steps, strict=True))
    if math.prod(map(_count, size)) > MAX_ELEMENTS:
        raise pickle.UnpicklingError(f"it contains a tensor {tuple(size)}, which is too large")
    if math.prod(size) and last >= len(flat):
        raise pickle.UnpicklingError("it contains a tensor larger than its numbers")
    return flat.as_strided(tuple(size), steps, offset).detach().numpy().copy()


def build(value: Any, done: dict[int, Any] | None = None) -> Any:
    """The same with arrays instead of records, in whatever containers; ValueError or
    UnpicklingError when a record states what can't be."""
    done = {} if done is None else done
    if id(value) not in done:
        done[id(value)] = _built(value, done)
    return done[id(value)]


def _built(value: Any, done: dict[int, Any]) -> Any:
    if isinstance(value, ArrayRecord) and value.state:
        _, shape, dtype, fortran, content = value.state
        if isinstance(content, list):
            return _of_objects([build(item, done) for item in content], shape)
        return _from_bytes(content, dtype, shape, bool(fortran))
    if isinstance(value, JoblibRecord):
        state = value.state
        if state["dtype"].dtype.hasobject:
            return build(value.content, done)
        fortran = state.get("order") == "F"
        return _from_bytes(value.content, state["dtype"], state.get("shape"), fortran)
    if isinstance(value, torch.Tensor):
        return value.detach().cpu().numpy()
    if isinstance(value, dict):
        return {key: build(item, done) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [build(item, done) for item in value]
    return value


def _from_bytes(content: Any, dtype: Any, shape: Any, fortran: bool) -> np.ndarray:
    """An array of some bytes, which must be as many as its form needs."""
    if isinstance(content, str):  # Python 2's bytes
        content = content.encode("latin1")
    if isinstance(dtype, DtypeRecord) and not dtype.dtype.itemsize:
        raise pickle.UnpicklingError("it contains an array of empty words")
    if not isinstance(dtype, DtypeRecord) or not isinstance(content, (bytes, bytearray)):
        raise pickle.UnpicklingError("it contains an array without numbers")
    kind = dtype.dtype
    sizes = _sizes(shape)
    if kind.hasobject or len(content) != math.prod(sizes) * kind.itemsize:
        raise pickle.UnpicklingError(f"it contains an array {sizes} of {len(content)} bytes")
    if not len(content):
        return np.zeros(sizes, kind)
    flat = np.frombuffer(bytes(content), dtype=kind)
    return flat.reshape(sizes, order="F" if fortran else "C").astype(kind.newbyteorder("="))


def _of_objects(items: list[Any], shape: Any) -> np.ndarray:
    sizes = _sizes(shape)
    if len(items) != math.prod(sizes):
        raise pickle.UnpicklingError(f"it contains an array {sizes} of {len(items)} things")
    array = np.empty(len(items), dtype=object)
    for n, item in enumerate(items):
        array[n] = item
    return array.reshape(sizes)


def _sizes(shape: Any) -> tuple[int, ...]:
    if not isinstance(shape, (tuple, list)) or len(shape) > 16:
        raise pickle.UnpicklingError("it contains an array without a shape")
    return tuple(_count(n) for n in shape)


def _count(value: Any) -> int:
    if not isinstance(value, int) or not 0 <= value < 2**40:
        raise pickle.UnpicklingError(f"it contains an array of size {value!r:.20}")
    return int(value)


UNREADABLE: tuple[type[Exception], ...] = (
    *(pickle.UnpicklingError, AttributeError, IndexError, KeyError, TypeError, ValueError),
    *(MemoryError, OverflowError, RecursionError, EOFError, OSError, RuntimeError, SyntaxError),
    *(tokenize.TokenError, AssertionError, struct.error, zlib.error, LZMAError),
    zipfile.BadZipFile,
)
"""What damaged or unsafe pickles, and the compressed files around them, raise when read."""


def load_pickle(content: bytes) -> Any:
    """What a pickle holds: tensors as numpy arrays, tuples as lists.

    Raises one of `UNREADABLE` when the pickle is damaged or would run something.
    """
    value = RestrictedUnpickler(io.BytesIO(content)).load()
    # refuses values of too many nested parts, those in several places counted in each
    _size(value, {}, set())
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


_ALLOWED: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): NdarrayClass,
    ("numpy", "dtype"): DtypeRecord,
    ("_codecs", "encode"): _encode,
    ("joblib.numpy_pickle", "NumpyArrayWrapper"): JoblibRecord,
    ("collections", "OrderedDict"): CONTAINERS["dict"],
    ("collections", "defaultdict"): defaultdict_of,
    ("torch._utils", "_rebuild_tensor_v2"): tensor,
    ("torch.storage", "_load_from_bytes"): storage,
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

    def __init__(self, stream: io.BytesIO) -> None:
        super().__init__(stream, encoding="latin1")
        self._raw = stream

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _ALLOWED:
            return _ALLOWED[module, name]
        raise pickle.UnpicklingError(f"it names {module}.{name}, which is not allowed here")

    def load_build(self) -> None:
        stack: list[Any] = self.stack  # type: ignore[attr-defined]
        state, record = stack.pop(), stack[-1]
        if not isinstance(record, (ArrayRecord, DtypeRecord, JoblibRecord)):
            raise pickle.UnpicklingError(f"it would change a {type(record).__name__}")
        record.restore(state)
        if isinstance(record, JoblibRecord):
            self._read_content(record)

    def _read_content(self, record: JoblibRecord) -> None:
        """The array that follows its record: another pickle, or bytes after some padding."""
        dtype = record.state["dtype"].dtype
        if dtype.hasobject:
            record.content = RestrictedUnpickler(self._raw).load()
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
