"""Unknown focal lengths, solved with the common motion as far as it determines them.

A focal length shows in how a body's near and far parts differ in size, and in how its size changes
along a path that the other videos see from elsewhere. Performances that differ change both for as
long as the action lasts, however many frames show it; so against the prior the focal likelihood
counts once per action. Where videos show one motion that is enough to find the focal length; where
they differ, or nothing moves much, the assumed value stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.terms import FocalPrior
from imocap_core.motion.terms.view import with_focal


@dataclass(frozen=True)
class FreeFocalLengths:
    """Videos whose focal lengths are unknowns, with their prior.

    Attributes:
        videos: F indices, in the order of the state's focal lengths.
        assumed_px: (F,) the prior's means; weight: (F,) of the squared error of a logarithm.
    """

    videos: Sequence[int]
    assumed_px: Float[Tensor, " F"]
    weight: Float[Tensor, " F"]

    def prior(self, K: Float[Tensor, "M 3 3"]) -> list[FocalPrior]:
        """The prior as a term about views with intrinsics K."""
        if not self.videos:
            return []
        now = K[list(self.videos), 0, 0]
        return [FocalPrior((self.assumed_px.to(now) / now).log(), self.weight.to(now))]

    def intrinsics(
        self, K: Float[Tensor, "M 3 3"], log_focal: Float[Tensor, " F"]
    ) -> Float[Tensor, "M 3 3"]:
        """K with the focal lengths of a state."""
        K, free = K.clone(), list(self.videos)
        K[free] = with_focal(K[free], log_focal.exp())
        return K


NO_FREE_FOCAL_LENGTHS = FreeFocalLengths((), torch.zeros(0), torch.zeros(0))


def free_focal_lengths(scene: Scene) -> FreeFocalLengths:
    """The unknown focal lengths of a scene's videos."""
    videos = [v for v, o in enumerate(scene.observations) if o.focal_spread > 0]
    spread = torch.tensor([scene.observations[v].focal_spread for v in videos])
    frames = len(scene.timeline.from_reference[scene.reference])
    return FreeFocalLengths(videos, scene.K[videos, 0, 0], frames / spread**2)
