"""What the networks have in common: they are functions of one picture, and speak in logits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

LARGEST_LOGIT = 100.0
Network = Callable[[np.ndarray], list[np.ndarray]]  # outputs of a float32 picture (size, size, 3)


def sigmoid(logits: np.ndarray) -> np.ndarray:
    """Probabilities of logits."""
    clipped = np.clip(logits.astype(float), -LARGEST_LOGIT, LARGEST_LOGIT)
    return np.asarray(1 / (1 + np.exp(-clipped)))
