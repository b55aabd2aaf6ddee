"""An action run on the processor and on a pretended CUDA device: results must be the same.

    python -m tools.check_on_pretended_cuda ACTION_FOLDER [GROUP.NAME=VALUE ...]

Finds what a card would refuse, on a machine without one (`tests/pretended_cuda.py`). Exit code 1
where a result differs.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from imocap_core.library.running import run_action
from tests.pretended_cuda import Pretended, pretended_cuda


def digests(action: Path, params: Sequence[str], device: str) -> dict[str, str]:
    """Stage -> digest of its result, all made in an empty working folder."""
    with TemporaryDirectory() as root:
        done = run_action(action, root=root, params=list(params), device=device)
        return {outcome.stage: outcome.stored.digest for outcome in done.outcomes}


def main(action: str, *params: str) -> int:
    """Run an action on both, and print which results are the same."""
    here = digests(Path(action), params, "cpu")
    with pretended_cuda():
        there = digests(Path(action), params, "cuda")
    for stage, digest in here.items():
        print(f"{stage:15} {'the same' if there[stage] == digest else 'OTHER'}")
    print(f"{Pretended.calls} calls with tensors of the pretended device")
    return int(here != there)


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
