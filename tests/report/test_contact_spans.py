"""Contacts of the feet on the viewer's common axis."""

import numpy as np

from imocap_core.viewer.viewer_scene import contact_spans


def test_contacts_are_on_the_common_axis() -> None:
    phase = np.array([0.5, 0.6, 0.6, 0.9, 1.3])
    spans = contact_spans({"left": [(0, 2), (4, 4)], "right": []}, phase)
    assert spans == {"left": [[0.5, 0.6], [1.3, 1.3]], "right": []}
