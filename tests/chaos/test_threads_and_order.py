"""Results depend neither on the number of threads nor on what ran before."""

from pathlib import Path

from tests.chaos.run import vary_threads
from tests.chaos.small_action import SmallAction

ALONE = ("sync", "smpl_ba", "evaluate")  # `make chaos`: every stage


def test_four_threads_and_stages_alone_give_the_digests_of_one_thread(tmp_path: Path) -> None:
    part = vary_threads(SmallAction.make(tmp_path), counts=(4,), alone=ALONE)
    assert (part["tried"], part["lost"]) == (1 + len(ALONE), 0), part["what"]
