"""Joints that aitviewer gets from a file of AMASS's kind, run by an interpreter that has aitviewer.

python aitviewer_joints.py FILE MODELS OUT

MODELS has smplh/SMPLH_FEMALE.npz, which aitviewer takes for the gender neutral. OUT is a .npy of
the joints (T, J, 3), metres, in the file's axes.
"""

from __future__ import annotations

import sys

import numpy as np


def main() -> None:
    """Read as its users do: `SMPLSequence.from_amass`."""
    file, models, out = sys.argv[1:]
    from aitviewer.configuration import CONFIG

    CONFIG.update_conf({"smplx_models": models, "device": "cpu"})
    from aitviewer.models.smpl import SMPLLayer
    from aitviewer.renderables.smpl import SMPLSequence

    with np.load(file) as data:
        layer = SMPLLayer(model_type="smplh", gender=data["gender"].item(), ext="npz")
    np.save(out, SMPLSequence.from_amass(file, smpl_layer=layer).joints)


main()
