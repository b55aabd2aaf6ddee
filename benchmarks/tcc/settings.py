"""Every choice of the baseline in one value, and the two that are used."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class TccSettings:
    """Temperature and variance weight are those of the paper's released code; the schedule is
    short, as it learns one action at a time (docs/tcc.md)."""

    embedding: int  # channels D of the embedding
    taps: int  # frames that a frame is embedded from, itself in the middle; odd
    spacing_s: float  # time between two of them
    steps: int  # of Adam
    sampled: int  # frames of each video in one step
    noise: float  # standard deviation added to the inputs in training
    mirrored: float = 0.5  # how often a clip is mirrored in training
    learning_rate: float = 1e-3
    weight_decay: float = 1e-5
    temperature: float = 0.1  # similarity = -squared distance / (D * temperature)
    variance_weight: float = 0.001  # lambda of the cycle-back regression
    unmatched_level: float = np.inf  # see `align`; inf: every frame is matched
    confidence_reach_s: float = 0.1  # confidence = soft match within this much of the position


POSES = TccSettings(embedding=64, taps=9, spacing_s=0.1, steps=300, sampled=64, noise=0.05)
FRAMES = TccSettings(embedding=64, taps=3, spacing_s=0.25, steps=150, sampled=24, noise=0.1)
