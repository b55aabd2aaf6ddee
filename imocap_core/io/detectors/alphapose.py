"""AlphaPose: `alphapose-results.json`, one list per clip with one entry per person and frame.

As AlphaPose documents it: ``image_id`` is the picture's name (``12.jpg`` of a video is frame 12),
``category_id`` 1, ``keypoints`` x, y (pixels) and confidence of every point, and ``score`` of the
person; newer versions add ``box`` and ``idx``. Models of COCO have 17 points, of Halpe 26 or 136,
of COCO-WholeBody 133. Confidences of heat maps may exceed 1 and then count as 1. The person's
score, box and track are not used: people are tracked by their joints.
"""

from __future__ import annotations

from pathlib import Path

from imocap_core.io.detectors.coco import read_entries
from imocap_core.io.detectors.people import DetectedPeople


def read_alphapose(path: Path, layout: str) -> DetectedPeople:
    """All people of all frames in a results file.

    ValueError names file, field, expected and got.
    """
    return read_entries(path, layout, "AlphaPose")
