"""Synchronisation of videos by 3D poses (section 3.1; Eq. 1, 2).

Reading order: synchronise, evidence, anchors, sound, maps, freeze_frames, joint_synchronisation,
procrustes, comparable_poses, affinity, axes, cycle, reference, time_axis, confidence, hypotheses,
repetition, screening/, warp/.
"""

from imocap_core.sync.anchors import Anchor, Hints
from imocap_core.sync.evidence import SyncEvidence
from imocap_core.sync.joint_synchronisation import SyncResult
from imocap_core.sync.synchronise import estimated_rates, screened, synchronise

__all__ = [
    "Anchor",
    "Hints",
    "SyncEvidence",
    "SyncResult",
    "estimated_rates",
    "screened",
    "synchronise",
]
