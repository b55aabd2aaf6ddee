"""What a benchmark runs, checked: its name, the simulated inputs, the actions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchmarks.actions.captured import DEFAULT_VIDEOS, MAX_VIDEOS
from benchmarks.synthetic.detector_presets import DETECTORS
from benchmarks.synthetic.frame_sampling import SAMPLINGS
from imocap_core.errors import WrongUse

NAMES = ("protocol", "trials", "yoga", "real", "h36m")
AS_GIVEN = ("yoga", "real")  # nothing about them can be chosen
MADE_VIEWS = ("protocol", "trials")  # filmed by as many made cameras as are asked for
TITLES = {
    "protocol": "The paper's protocol: one motion, resampled",
    "trials": "The real task: every video another performance",
    "yoga": "The project's own demo",
    "real": "Real video of four phones",
    "h36m": "Human3.6M: the paper's data and protocol",
}
DATA = {
    "protocol": "CMU motion capture (mocap.cs.cmu.edu, NSF EIA-0196217), five clips",
    "trials": "CMU motion capture (mocap.cs.cmu.edu, NSF EIA-0196217), six actions; tennis strokes "
    "of Pulgarin-Giraldo et al., LNCS 10125 (2017), four actions",
    "yoga": "made by the project",
    "real": "Pose2Sim's demos (BSD-3-Clause); the reference is their calibrated triangulation",
    "h36m": "Human3.6M, subjects S9 and S11, 2D by CPN fine-tuned on it (VideoPose3D's files)",
}
RESAMPLED = ("protocol", "h36m")


@dataclass(frozen=True)
class Choice:
    """What to run.

    detector: level of the simulated 2D detector. sampling: how one motion is resampled (protocol
    and h36m). videos: at most, per action. only: the actions (all when empty). outlier: whether a
    video of another action is added. data: folder with the files of Human3.6M.
    """

    name: str
    detector: str = "fine_tuned"
    sampling: str = "released"
    videos: int = DEFAULT_VIDEOS
    only: tuple[str, ...] = ()
    outlier: bool = False
    data: Path | None = None

    def __post_init__(self) -> None:
        for field, value, allowed in (
            ("benchmark", self.name, NAMES),
            ("--detector", self.detector, tuple(DETECTORS)),
            ("--sampling", self.sampling, SAMPLINGS),
        ):
            if value not in allowed:
                raise WrongUse(f"{field}: expected one of {', '.join(allowed)}, got {value!r}")
        most = MAX_VIDEOS if self.name in MADE_VIEWS else DEFAULT_VIDEOS
        if not 1 <= self.videos <= most:
            raise WrongUse(f"--videos: expected 1 to {most}, got {self.videos}")
        if self.name == "h36m" and self.data is None:
            raise WrongUse("--data: the benchmark h36m needs the folder with VideoPose3D's files")

    @property
    def label(self) -> str:
        """The name of this choice's folder and table."""
        parts = [self.set_label]
        if self.name in ("protocol", "trials"):
            parts.append(self.detector)
        if self.name not in AS_GIVEN:
            parts.append(f"{self.videos}v")
        return "-".join([*parts, "outlier"] if self.outlier else parts)

    @property
    def set_label(self) -> str:
        """The name of its data, without the detector and the number of videos."""
        return f"{self.name}-{self.sampling}" if self.name in RESAMPLED else self.name

    @property
    def command(self) -> str:
        """The command that measures all actions of this choice."""
        words = [f"imocap benchmark {self.name}"]
        if self.name in ("protocol", "trials"):
            words.append(f"--detector {self.detector}")
        if self.name not in AS_GIVEN:
            words.append(f"--videos {self.videos}")
        if self.name in RESAMPLED:
            words.append(f"--sampling {self.sampling}")
        if self.data is not None:
            words.append("--data FOLDER")
        return " ".join(words)

    def folder(self, root: Path) -> Path:
        """The folder of its actions, artifacts, scores and tables."""
        return root / "artifacts" / "benchmark" / self.label
