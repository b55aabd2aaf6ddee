"""Every setting of the baseline in one value, and the value in use."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class TccSettings:
    """Temperature and variance weight are those of the paper's released code; the schedule is short
    because each training sees one action only (docs/measurements.md)."""

    embedding: int  # channels D of the embedding
    taps: int  # frames of the window that is embedded, centred on its frame; odd
    spacing_s: float  # time between two frames of the window
    steps: int  # of Adam
    sampled: int  # frames of each video in one step
    noise: float  # standard deviation added to the inputs in training
    mirrored: float = 0.5  # probability that a clip is mirrored in a step of training
    learning_rate: float = 1e-3
    weight_decay: float = 1e-5
    temperature: float = 0.1  # similarity = -squared distance / (D * temperature)
    variance_weight: float = 0.001  # lambda of the cycle-back regression
    unmatched_level: float = np.inf  # see `align`; inf: every frame is matched
    confidence_reach_s: float = 0.1  # confidence = soft match within this much of the position


POSES = TccSettings(embedding=64, taps=9, spacing_s=0.1, steps=300, sampled=64, noise=0.05)
