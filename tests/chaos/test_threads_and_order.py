"""Results depend neither on the number of threads nor on what ran before."""

from __future__ import annotations

from pathlib import Path

from tests.chaos.run import STAGES, vary_threads
from tests.chaos.small_action import SmallAction


def test_four_threads_and_every_stage_alone_give_the_digests_of_one_thread(
    tmp_path: Path,
) -> None:
    part = vary_threads(SmallAction.make(tmp_path), counts=(4,))
    assert (part["tried"], part["lost"]) == (1 + len(STAGES), 0), part["what"]
