"""Which errors a posterior counts as independent.

The solver needs a minimum; a standard deviation needs the number of independent observations.
Detector errors and deviations of a performance persist over neighbouring frames, a pose persists
longer still, and one performer has one body. Each is counted once per its own correlation time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from imocap_core.motion.multiview.scene import Scene
from imocap_core.motion.terms import Term
from imocap_core.motion.terms.evidence import JointEvidence
from imocap_core.motion.terms.reprojection import Reprojection
from imocap_core.motion.terms.tempered import Tempered
from imocap_core.params import MotionParams, UncertaintyParams

POPULATION = 1.0  # betas are in standard deviations of the population


@dataclass(frozen=True)
class Noise:
    """How long the errors behind the evidence persist."""

    params: UncertaintyParams

    def evidence_share(self, fps: float) -> float:
        """Weight of one frame's image evidence: 1 over the frames of a correlation time."""
        return 1 / max(1.0, self.params.correlation_s * fps)

    def scene(self, scene: Scene, videos: int) -> Scene:
        """The scene with the priors of a posterior; ``videos`` share one body's prior."""
        prior = 1 / max(1.0, self.params.pose_persistence_s * scene.fps)
        fit = replace(
            scene.fit,
            pose_prior=min(prior, scene.fit.pose_prior),
            shape_prior=POPULATION / videos,
            hidden_shape_prior=POPULATION / videos,
            size_prior=POPULATION / videos,
        )
        return replace(scene, fit=fit)

    def options(self, options: MotionParams) -> MotionParams:
        """The options with the correlation time of the posterior."""
        return replace(options, correlation_s=self.params.correlation_s)

    def temper(self, terms: list[Term], fps: float) -> list[Term]:
        """The terms, image and estimate evidence with its share."""
        share = self.evidence_share(fps)
        evidence = (Reprojection, JointEvidence)
        return [Tempered(term, share) if isinstance(term, evidence) else term for term in terms]
