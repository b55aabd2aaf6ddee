"""The device that a run's tensors are computed on: the processor, or a CUDA device."""

from __future__ import annotations

import re

from imocap_core.errors import WrongUse

CPU = "cpu"


def check_device(name: str) -> None:
    """WrongUse where it is no device, or PyTorch has none of that name here.

    name: cpu, cuda, or one of several as cuda:1.
    """
    match = re.fullmatch(r"cpu|cuda(?::(\d{1,3}))?", name)
    if match is None:
        raise WrongUse(f"device: expected cpu, cuda or cuda:1, got {name!r}")
    if name == CPU:
        return
    import torch

    count = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if int(match[1] or 0) >= count:
        there = {0: "no CUDA device", 1: "one CUDA device (cuda)"}.get(
            count, f"CUDA devices cuda:0 to cuda:{count - 1}"
        )
        why = "" if torch.version.cuda else ", in a build without CUDA"
        raise WrongUse(f"device {name}: PyTorch finds {there} here{why}; leave it out to use cpu")
