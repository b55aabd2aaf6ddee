"""The names of formats and layouts, as action.yaml and the command line take them."""

from typing import Literal

DetectionFormat = Literal[
    "openpose", "alphapose", "mmpose", "coco", "easymocap", "ultralytics", "mediapipe", "halpe26",
    "wholebody", "cpn_npz", "npz", "sam3d_body",
]  # fmt: skip
Layout = Literal[
    "body25", "body25b", "coco17", "coco18", "halpe26", "halpe136", "wholebody133", "h36m17",
    "penn13", "mediapipe33", "blazepose33",
]  # fmt: skip
InitialFormat = Literal[
    "smpl_npz", "joints_npz", "hmr2", "wham", "gvhmr", "gem", "prompthmr", "vibe", "hmmr", "tram",
    "tokenhmr", "sam3d_body", "mediapipe_world",
]  # fmt: skip
