"""Focal lengths that nobody told: solved with the common motion, as far as it tells them.

A focal length shows in how a body's near and far parts differ in size, and in how its size changes
along a path that the other videos see from elsewhere. Performances that differ change both for as
long as the action lasts, however many frames show it; so against what is assumed the whole action
counts as one look. Where videos show one motion that is enough to find the focal length; where
they differ, or nothing moves much, the assumption stays.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.terms import FocalPrior
from imocap_core.motion.terms.view import with_focal


@dataclass(frozen=True)
class Lenses:
    """Videos whose focal lengths are unknowns.

    Attributes:
        videos: indices, in the order of the state's focal lengths.
        assumed_px: (L,) what their focal lengths are thought to be; weight: (L,) of the squared
            error of a logarithm.
    """

    videos: Sequence[int]
    assumed_px: Tensor
    weight: Tensor

    def prior(self, K: Tensor) -> list[FocalPrior]:
        """What is assumed, about views with intrinsics K (M, 3, 3)."""
        if not self.videos:
            return []
        now = K[list(self.videos), 0, 0]
        return [FocalPrior((self.assumed_px.to(now) / now).log(), self.weight.to(now))]

    def found(self, K: Tensor, log_focal: Tensor) -> Tensor:
        """K (M, 3, 3) with the focal lengths of a state (L,)."""
        K, own = K.clone(), list(self.videos)
        K[own] = with_focal(K[own], log_focal.exp())
        return K


NO_LENSES = Lenses((), torch.zeros(0), torch.zeros(0))


def lenses_of(scene: Scene) -> Lenses:
    """The focal lengths that a scene's videos leave open."""
    videos = [v for v, o in enumerate(scene.observations) if o.focal_spread > 0]
    spread = torch.tensor([scene.observations[v].focal_spread for v in videos])
    frames = len(scene.timeline.from_reference[scene.reference])
    return Lenses(videos, scene.K[videos, 0, 0], frames / spread**2)
