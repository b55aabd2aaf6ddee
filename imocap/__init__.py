"""Motion capture from several unsynchronised, uncalibrated videos.

    import imocap

    result = imocap.run("serve")                    # or imocap.run(videos=["a.mp4", "b.mp4"])
    result = imocap.load("artifacts/serve")         # a run that exists
    video = result["serve1"]
    video.joints, video.rotations, video.camera, video.time_s, video.uncertainty
    result.at_phase(1.2)                            # the same moment in every video
    print(result.verdict)                           # what to know about it, in three sentences
    result.export("bvh", "out")
    sync = imocap.synchronise([a_joints, b_joints], fps=30)

Lengths are metres, angles radians and times seconds, unless a name says otherwise (`_mm`, `_px`,
`_deg`). A missing value is NaN. Bad input raises `ImocapError`: `WrongUse` for a call that was not
understood, `WorkFailed` for work that cannot be done, with the sentence of the command line.

Importing changes no setting of the process and loads nothing heavy (PyTorch, PyAV, Matplotlib):
a function loads what it needs.
"""

from imocap_core.biomechanics.events import MotionEvent
from imocap_core.camera.ground_plane import Ground
from imocap_core.conventions import SMPL_JOINTS, SMPL_PARENTS, SMPLH_JOINTS, SMPLH_PARENTS
from imocap_core.diagnostics.findings import Finding, Verdict
from imocap_core.errors import ImocapError, WorkFailed, WrongUse
from imocap_core.library.new_action import CollectedAction, collect, init_action
from imocap_core.library.outputs import (
    ActionComparison,
    ExportOptions,
    angles,
    compare,
    export,
    report,
    view,
)
from imocap_core.library.people import PersonSummary, VideoPeople, detect, people
from imocap_core.library.result import Result, load
from imocap_core.library.run_all import ActionEnd, ExecutorChoice, run_all
from imocap_core.library.running import Run, run, run_stage
from imocap_core.library.status import Explanation, explain, status
from imocap_core.library.synchronising import synchronise
from imocap_core.result.video import (
    FrameMatches,
    HandMotion,
    JointUncertainty,
    Synchronisation,
    VideoCamera,
    VideoMoment,
    VideoResult,
    VideoSync,
)
from imocap_core.version import __version__ as __version__

__all__ = [
    "SMPLH_JOINTS",
    "SMPLH_PARENTS",
    "SMPL_JOINTS",
    "SMPL_PARENTS",
    "ActionComparison",
    "ActionEnd",
    "CollectedAction",
    "ExecutorChoice",
    "Explanation",
    "ExportOptions",
    "Finding",
    "FrameMatches",
    "Ground",
    "HandMotion",
    "ImocapError",
    "JointUncertainty",
    "MotionEvent",
    "PersonSummary",
    "Result",
    "Run",
    "Synchronisation",
    "Verdict",
    "VideoCamera",
    "VideoMoment",
    "VideoPeople",
    "VideoResult",
    "VideoSync",
    "WorkFailed",
    "WrongUse",
    "angles",
    "collect",
    "compare",
    "detect",
    "explain",
    "export",
    "init_action",
    "load",
    "people",
    "report",
    "run",
    "run_all",
    "run_stage",
    "status",
    "synchronise",
    "view",
]
