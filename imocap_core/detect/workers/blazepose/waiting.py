"""How many pictures wait for the next one that is looked at."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from .even import LONGEST, is_even
from .followed import FollowedPerson
from .overlap import is_in_the_way


def frames_to_next_look(people: Sequence[FollowedPerson]) -> int:
    """One where somebody is new, or nobody moves evenly; two where somebody does, LONGEST where all
    do and nobody is in another's way."""
    if any(not person.is_established for person in people):
        return 1
    is_even_long = people and all(is_even(person.looks, LONGEST) for person in people)
    if is_even_long and not _are_in_each_others_way(people):
        return LONGEST
    return 2 if any(is_even(person.looks, 2) for person in people) else 1


def _are_in_each_others_way(people: Sequence[FollowedPerson]) -> bool:
    return any(
        is_in_the_way(a.body, b.body) or is_in_the_way(b.body, a.body)
        for a, b in combinations(people, 2)
    )
