"""Parts of a stage's result that less than the whole determines, kept beside the results.

A part is stored under a key of its own: the stage's code, parameters and seed, and what the part
is made from. Whoever needs it again finds it: the same action after a video was added, or another
action that has the video.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeVar

from imocap_core.artifacts.cache import mark_used
from imocap_core.artifacts.store import Store
from imocap_core.pipeline.recipe import Recipe

if TYPE_CHECKING:
    from imocap_core.artifacts.schemas.base import Artifact

Kind = TypeVar("Kind", bound="Artifact")


@dataclass(frozen=True)
class Parts:
    """The stored parts of one stage's results.

    Attributes:
        recipe: of the whole result; again: make every part, even one that is stored.
    """

    store: Store
    action: str
    stage: str
    recipe: Recipe
    again: bool = False

    def get(
        self,
        name: str,
        made_from: Mapping[str, Artifact | str],
        kind: type[Kind],
        make: Callable[[], Kind],
    ) -> Kind:
        """The part of this name that is made from nothing but ``made_from``: stored, or made now.

        made_from: artifacts, and digests or values as text.
        """
        from imocap_core.artifacts import codec

        digests = {
            title: value if isinstance(value, str) else codec.pack(value).digest
            for title, value in made_from.items()
        }
        recipe = replace(self.recipe, inputs=digests, reads={})
        folder = f"{self.stage}_{name}"
        stored = None if self.again else self.store.find(self.action, folder, recipe.key)
        made = stored is None
        if stored is None:
            stored = self.store.put(folder, recipe.key, make(), recipe.provenance(), {})
        stored = self.store.share(folder, stored, made=made)
        mark_used(self.store.folder, self.action, folder, stored.key)
        return stored.decode(kind)
