"""Temporal Cycle-Consistency Learning (Dwibedi et al., CVPR 2019), trained on the clips to align.

A network embeds every frame; cycle consistency between the clips is all that it learns from. The
clips are then aligned by DTW on distances between embeddings. See docs/measurements.md.
"""

from benchmarks.tcc.alignment import TccAlignment, align, align_by_tcc
from benchmarks.tcc.clips import pose_clip
from benchmarks.tcc.encoders import PoseEncoder
from benchmarks.tcc.loss import cycle_back_regression
from benchmarks.tcc.settings import POSES, TccSettings
from benchmarks.tcc.training import TccTraining, train

__all__ = [
    "POSES",
    "PoseEncoder",
    "TccAlignment",
    "TccSettings",
    "TccTraining",
    "align",
    "align_by_tcc",
    "cycle_back_regression",
    "pose_clip",
    "train",
]
