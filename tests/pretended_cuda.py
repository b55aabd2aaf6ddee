"""CUDA tensors pretended on the processor: what would fail on a card fails, all else computes.

A tensor that pretends says that its device is cuda:0, and what is computed from it does so too. As
on a card it meets no tensor of the processor but a single number, has no NumPy array, and is
copied from and to the processor by `to` and `cpu` only. What it can't find: a function that CUDA
has not, other rounding, and order of summation.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.utils._pytree import tree_map

from imocap_core.lifter.lifter_network import load_lifter
from imocap_core.motion.prior import load_pose_prior

DEVICE = torch.device("cuda", 0)
MAKERS = "arange empty eye full linspace ones rand randn tensor as_tensor zeros"
TO, GET_ITEM = Tensor.to, Tensor.__getitem__
ONLY_ON_ONE_DEVICE = {  # even of single numbers
    torch.cat, torch.stack, torch.matmul, Tensor.matmul, Tensor.__matmul__, torch.einsum,
}  # fmt: skip


class Pretended(Tensor):
    """A tensor of the processor that behaves as if it were on a CUDA device.

    calls: of functions with such tensors.
    """

    calls = 0

    @classmethod
    def __torch_function__(
        cls, func: Callable[..., Any], types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        kwargs = dict(kwargs or {})
        if func in ANSWERS:
            return ANSWERS[func]
        if func.__name__ == "__get__":  # shape, dtype and so on
            with torch._C.DisableTorchFunctionSubclass():
                return pretended(func(*args))
        if func in (Tensor.numpy, Tensor.__array__):
            raise TypeError("can't convert cuda:0 device type tensor to numpy")
        if func is Tensor.cpu:
            return _plain(args[0])
        if func is TO:
            return moved(*args, **kwargs)
        _must_be_on_one_device(func, args, kwargs)
        Pretended.calls += 1
        device = kwargs.pop("device", None)
        with torch._C.DisableTorchFunctionSubclass():
            result = func(*args, **kwargs)
        return result if device is not None and not is_cuda(device) else pretended(result)


ANSWERS = {
    Tensor.device.__get__: DEVICE,
    Tensor.is_cuda.__get__: True,
    Tensor.is_cpu.__get__: False,
    Tensor.get_device: 0,
    torch._has_compatible_shallow_copy_type: False,
}


def is_cuda(device: Any) -> bool:
    """Whether a tensor or a device is on CUDA, pretended."""
    if isinstance(device, Tensor):
        return isinstance(device, Pretended)
    return device is not None and torch.device(device).type == "cuda"


def pretended(value: Any) -> Any:
    """All tensors of a value on the pretended device."""

    if type(value) is Tensor:
        return value.as_subclass(Pretended)
    return tree_map(pretended, value) if isinstance(value, (list, tuple)) else value


def moved(x: Tensor, *args: Any, **kwargs: Any) -> Tensor:
    """`Tensor.to`."""
    given = [*args, *(kwargs[k] for k in ("device", "other") if k in kwargs)]
    targets = [a for a in given if isinstance(a, (Tensor, str, torch.device))]
    to_cuda = is_cuda(targets[0]) if targets else isinstance(x, Pretended)

    def on_processor(a: Any) -> Any:
        if isinstance(a, Tensor):
            return _plain(a)
        return torch.device("cpu") if isinstance(a, (str, torch.device)) else a

    plain = TO(
        _plain(x), *map(on_processor, args), **{k: on_processor(v) for k, v in kwargs.items()}
    )
    crosses = to_cuda != isinstance(x, Pretended)
    plain = plain.clone() if crosses and plain.data_ptr() == x.data_ptr() else plain
    return pretended(plain) if to_cuda else plain


def _plain(x: Tensor) -> Tensor:
    with torch._C.DisableTorchFunctionSubclass():
        return x.as_subclass(Tensor) if isinstance(x, Pretended) else x


def _must_be_on_one_device(func: Callable[..., Any], args: Any, kwargs: Any) -> None:
    least = 0 if func in ONLY_ON_ONE_DEVICE else 1
    if func is GET_ITEM and isinstance(args[0], Pretended):
        return  # indices may be on the processor
    if func is Tensor.copy_:
        return
    for x in _tensors([*args, *kwargs.values()]):
        if not isinstance(x, Pretended) and x.ndim >= least:
            name = getattr(func, "__name__", func)
            raise RuntimeError(
                f"Expected all tensors to be on the same device, but found at least two devices, "
                f"cuda:0 and cpu! (in {name})"
            )


def _tensors(values: Sequence[Any]) -> Iterator[Tensor]:
    for x in values:
        if isinstance(x, Tensor):
            yield x
        elif isinstance(x, (list, tuple)):
            yield from _tensors(x)


def _maker(make: Callable[..., Any]) -> Callable[..., Any]:
    def made(*args: Any, **kwargs: Any) -> Any:
        given = bool(args) and isinstance(args[0], Pretended)
        device = kwargs.pop("device", args[0] if given else None)
        result = make(*((_plain(args[0]), *args[1:]) if given else args), **kwargs)
        return pretended(result) if is_cuda(device) else result

    return made


def _item(x: Tensor, index: Any) -> Any:
    if not isinstance(x, Pretended) and any(isinstance(i, Pretended) for i in _tensors([index])):
        raise RuntimeError("indices should be on the same device as the indexed tensor (cpu)")
    return GET_ITEM(x, index)


@contextmanager
def pretended_cuda() -> Iterator[None]:
    """In the body, "cuda" is a device: a pretended one."""
    forget = (load_lifter.cache_clear, load_pose_prior.cache_clear)
    with pytest.MonkeyPatch.context() as patch:
        for name in MAKERS.split():
            patch.setattr(torch, name, _maker(getattr(torch, name)))
        patch.setattr(Tensor, "to", moved)
        patch.setattr(Tensor, "__getitem__", _item)
        patch.setattr(torch.cuda, "is_available", lambda: True)
        patch.setattr(torch.cuda, "device_count", lambda: 1)
        try:
            yield
        finally:
            for clear in forget:
                clear()
