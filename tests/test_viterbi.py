"""The cheapest sequence is the cheapest of all sequences."""

from itertools import pairwise, product

import numpy as np

from imocap_core.sequences import cheapest_states


def cost(states: tuple[int, ...], first: np.ndarray, steps: np.ndarray) -> float:
    moves = zip(steps, pairwise(states), strict=True)
    return float(first[states[0]] + sum(step[a, b] for step, (a, b) in moves))


def test_no_other_sequence_is_cheaper() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        first, steps = rng.random(3), rng.random((4, 3, 3))
        best = tuple(int(state) for state in cheapest_states(first, steps))
        every = product(range(3), repeat=5)
        assert best == min(every, key=lambda states: cost(states, first, steps))


def test_one_frame_is_in_its_cheapest_state() -> None:
    assert cheapest_states(np.array([2.0, 1.0]), np.zeros((0, 2, 2))).tolist() == [1]
