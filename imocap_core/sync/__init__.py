"""Synchronisation of videos by 3D poses (section 3.1; Eq. 1, 2).

Reading order:
    synchronise            synchronisation of videos by 3D poses (section 3.1; Eq. 1, 2): screening,
                           then the joint
    evidence               what a synchronisation goes by: the poses of all videos, and what is
                           known of them beforehand
    anchors                anchors: frames that show the same moment, given by the user; and spans
                           without a counterpart
    sound                  offsets between recordings of one event, by the onsets in their sound
    maps                   soft maps between all videos, one band a pair, and the block structure of
                           Eq. 1
    freeze_frames          freeze frames: videos as videos of distinct pictures, and results for all
                           their frames
    joint_synchronisation  joint synchronisation of videos that all show the action: from poses to
                           warps (section 3.1)
    procrustes             procrustes distance of every pair of poses, in closed form, and the
                           alignment itself
    comparable_poses       poses of all videos made comparable: checks, velocities, changes,
                           vertical motion
    affinity               squared distances between all frames of all videos, and affinities from
                           them (Eq. 1)
    axes                   maps to the reference, refined against what the other videos agree on, on
                           several time axes
    cycle                  cycle consistency of the pairwise maps (Eq. 2): maps agree with those
                           through a third video
    reference              the reference video: the central one, from every video compared with
                           every other
    time_axis              common time axis: a phase for every frame, from all pairwise maps;
                           consistency and pace
    confidence             calibrated confidence of matches, and matches that are a whole repetition
                           off
    hypotheses             joint choice of one monocular motion for each video, among several
                           hypotheses
    repetition             repetitions of one action in a long clip
    screening/             screening before the synchronisation: mirrored videos, and videos of
                           another action
    warp/                  time warping: the position of every frame of a video in another video
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
