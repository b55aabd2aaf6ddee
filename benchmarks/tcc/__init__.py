"""Temporal Cycle-Consistency Learning (Dwibedi et al., CVPR 2019), trained on the clips at hand.

A network embeds every frame; it learns from nothing but cycle consistency between the clips. The
clips are then aligned by DTW on distances between embeddings. See docs/tcc.md.
"""

from benchmarks.tcc.alignment import TccAlignment, align, align_by_tcc
from benchmarks.tcc.clips import FRAME_SIZE, frame_clip, person_crop, pose_clip
from benchmarks.tcc.encoders import FrameEncoder, PoseEncoder
from benchmarks.tcc.loss import cycle_back_regression
from benchmarks.tcc.settings import FRAMES, POSES, TccSettings
from benchmarks.tcc.training import Trained, train

__all__ = [
    "FRAMES",
    "FRAME_SIZE",
    "POSES",
    "FrameEncoder",
    "PoseEncoder",
    "TccAlignment",
    "TccSettings",
    "Trained",
    "align",
    "align_by_tcc",
    "cycle_back_regression",
    "frame_clip",
    "person_crop",
    "pose_clip",
    "train",
]
