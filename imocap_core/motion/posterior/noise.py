"""What a posterior counts as independent, and what it does not.

The solver needs a minimum; a standard deviation needs the number of independent looks. Detector
errors and deviations of a performance persist over neighbouring frames, a pose persists longer
still, and one performer has one body. Each is counted once per its own time here.
"""

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
        """What one frame's image evidence counts."""
        return 1 / max(1.0, self.params.correlation_s * fps)

    def scene(self, scene: Scene, videos: int) -> Scene:
        """The scene with priors as a posterior needs them; ``videos`` share one body's prior."""
        prior = 1 / max(1.0, self.params.pose_persistence_s * scene.fps)
        weights = replace(
            scene.weights,
            pose_prior=min(prior, scene.weights.pose_prior),
            shape_prior=POPULATION / videos,
        )
        return replace(scene, weights=weights)

    def options(self, options: MotionParams) -> MotionParams:
        """The options of a posterior: deviations persist for its own time."""
        return replace(options, correlation_s=self.params.correlation_s)

    def temper(self, terms: list[Term], fps: float) -> list[Term]:
        """The terms, those that look at images or at estimates with their share."""
        share = self.evidence_share(fps)
        looks = (Reprojection, JointEvidence)
        return [Tempered(term, share) if isinstance(term, looks) else term for term in terms]
