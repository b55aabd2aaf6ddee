"""Results depend neither on the number of threads nor on what ran before."""

import shutil

import pytest

from tools.chaos.run import vary_threads
from tools.chaos.small_action import SmallAction


@pytest.mark.long
def test_four_threads_and_stages_alone_give_the_digests_of_one_thread(small_run, tmp_path):
    """`make chaos` tries every stage alone, and more numbers of threads."""
    action = SmallAction.of(shutil.copytree(small_run.root, tmp_path / "work"))
    part = vary_threads(action, counts=(4,), alone=("sync", "smpl_ba"))
    assert (part["tried"], part["lost"]) == (3, 0), part["what"]
