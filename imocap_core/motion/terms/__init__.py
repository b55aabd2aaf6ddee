"""The terms of the objective, one idea a file.

A term has a cost (B,) at a state, and adds its linearisation there to the normal equations. The
solver sums terms and uses nothing else of them.
"""

from imocap_core.motion.terms.balance import Balance
from imocap_core.motion.terms.base import Term
from imocap_core.motion.terms.coupling import PathCoupling, PoseCoupling
from imocap_core.motion.terms.evidence import JointEvidence
from imocap_core.motion.terms.focal_prior import FocalPrior
from imocap_core.motion.terms.foot_contact import FootContact
from imocap_core.motion.terms.joint_acceleration import JointAcceleration
from imocap_core.motion.terms.limits import HingeLimits
from imocap_core.motion.terms.pose_prior import PosePriorTerm
from imocap_core.motion.terms.reprojection import Reprojection
from imocap_core.motion.terms.shape_prior import ShapePrior
from imocap_core.motion.terms.smoothness import PathSmoothness, PoseSmoothness
from imocap_core.motion.terms.view import View

__all__ = [
    "Balance",
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
    "ShapePrior",
    "Term",
    "View",
]
