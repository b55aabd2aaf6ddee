"""The terms of the objective, one idea a file.

A term has a cost (B,) at a state, and adds its linearisation there to the normal equations. The
solver sums terms and uses nothing else of them.
"""

from imocap_core.motion.terms.base import Term
from imocap_core.motion.terms.body_priors import (
    FocalPrior,
    HingeLimits,
    PosePriorTerm,
    ScorePrior,
    ShapePrior,
)
from imocap_core.motion.terms.contact import FootContact
from imocap_core.motion.terms.coupling import JointEvidence, PathCoupling, PoseCoupling
from imocap_core.motion.terms.reprojection import Reprojection
from imocap_core.motion.terms.smoothness import JointAcceleration, PathSmoothness, PoseSmoothness
from imocap_core.motion.terms.view import View

__all__ = [
    "FocalPrior",
    "FootContact",
    "HingeLimits",
    "JointAcceleration",
    "JointEvidence",
    "PathCoupling",
    "PathSmoothness",
    "PoseCoupling",
    "PosePriorTerm",
    "PoseSmoothness",
    "Reprojection",
    "ScorePrior",
    "ShapePrior",
    "Term",
    "View",
]
