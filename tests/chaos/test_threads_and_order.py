"""Results depend neither on the number of threads nor on what ran before."""

from __future__ import annotations

from pathlib import Path

from tests.chaos.run import STAGES, vary_threads
from tests.chaos.small_action import SmallAction


def test_one_two_and_four_threads_and_every_stage_alone_give_the_same_digests(
    tmp_path: Path,
) -> None:
    part = vary_threads(SmallAction.make(tmp_path))
    assert (part["tried"], part["lost"]) == (3 + len(STAGES), 0), part["what"]
