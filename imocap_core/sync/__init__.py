"""Synchronisation of videos by 3D poses (section 3.1; Eq. 1, 2).

Reading order:
    synchronise            the entry: screening, then the joint synchronisation
    screening/             mirrored videos, videos of another action
    joint_synchronisation  the method, step by step, of the videos that show the action
    blocks                 Eq. 1: all frames of all videos in one matrix
    pairwise/              distances and affinities of all pairs of frames (Eq. 1)
    warp/                  soft maps, DTW, templates, reprojection
    reference              the reference video by centrality
    cycle/                 cycle consistency of the maps (Eq. 2)
    refinement             maps to the reference, refined against the other videos
    map_consistency        cycle residuals of the pairwise maps
    phase                  the common time axis
    anchors                frames tied by the user; reference_anchors: on the reference's axis
    repetition/            repetitions of one action in a long clip
"""

from imocap_core.sync.anchors import Anchor, Hints
from imocap_core.sync.synchronise import SyncResult, estimated_rates, screened, synchronise

__all__ = ["Anchor", "Hints", "SyncResult", "estimated_rates", "screened", "synchronise"]
