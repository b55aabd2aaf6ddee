"""`imocap benchmark protocol`, `trials` and `yoga`: how good the motion is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from imocap_core.synthetic.levels import DETECTORS
from imocap_core.synthetic.samplings import SAMPLINGS
from stages.benchmarks.inputs import (
    MAX_VIDEOS,
    RESAMPLED_MAX_RATE,
    data_folder,
    make_action,
    protocol_shots,
    trial_shots,
)
from stages.benchmarks.score import ActionScore, score_action
from stages.benchmarks.tables import Benchmark, csv_text, json_text, markdown
from stages.harness.errors import WrongUse
from stages.harness.runner import Display, Job
from stages.harness.workspace import Workspace

NAMES = ("protocol", "trials", "yoga")
TITLES = {
    "protocol": "The paper's protocol: one motion, resampled",
    "trials": "The real task: every video another performance",
    "yoga": "The project's own demo",
}
DATA = {
    "protocol": "CMU motion capture (mocap.cs.cmu.edu, NSF EIA-0196217), five clips",
    "trials": "CMU motion capture (mocap.cs.cmu.edu, NSF EIA-0196217), six actions; tennis strokes "
    "of Pulgarin-Giraldo et al., LNCS 10125 (2017), four actions",
    "yoga": "made by the project",
}


@dataclass(frozen=True)
class Choice:
    """What to run: detector level, sampling (protocol), most videos an action, the actions (all
    when empty)."""

    name: str
    detector: str = "fine_tuned"
    sampling: str = "released"
    videos: int = MAX_VIDEOS
    only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for field, value, known in (
            ("benchmark", self.name, NAMES),
            ("--detector", self.detector, tuple(DETECTORS)),
            ("--sampling", self.sampling, SAMPLINGS),
        ):
            if value not in known:
                raise WrongUse(f"{field}: expected one of {', '.join(known)}, got {value!r}")
        if not 1 <= self.videos <= MAX_VIDEOS:
            raise WrongUse(f"--videos: expected 1 to {MAX_VIDEOS}, got {self.videos}")

    @property
    def label(self) -> str:
        """A name for this choice's folder."""
        parts = [self.name]
        if self.name != "yoga":
            parts += [self.sampling] if self.name == "protocol" else []
            parts += [self.detector, f"{self.videos}v"]
        return "-".join(parts)

    @property
    def command(self) -> str:
        """The command that makes it."""
        words = [f"imocap benchmark {self.name}"]
        if self.name != "yoga":
            words += [f"--detector {self.detector}", f"--videos {self.videos}"]
        if self.name == "protocol":
            words.append(f"--sampling {self.sampling}")
        return " ".join([*words, *(f"--only {name}" for name in self.only)])


def measure(workspace: Workspace, choice: Choice, display: Display) -> tuple[Benchmark, Path]:
    """Run what is not finished, write the tables after every action; them and their folder."""
    folder = workspace.root / "artifacts" / "benchmark" / choice.label
    scores: list[ActionScore] = []
    title, data = TITLES[choice.name], DATA[choice.name]
    detector = "" if choice.name == "yoga" else choice.detector
    for name, job in _jobs(workspace, choice, folder, display):
        scores.append(score_action(job, display, folder / "scores" / f"{name}.json"))
        benchmark = Benchmark(title, choice.command, data, detector, scores)
        (folder / "table.md").write_text(markdown(benchmark), encoding="utf-8")
        (folder / "numbers.csv").write_text(csv_text(benchmark), encoding="utf-8")
        (folder / "numbers.json").write_text(json_text(benchmark), encoding="utf-8")
    return benchmark, folder


def _jobs(
    workspace: Workspace, choice: Choice, folder: Path, display: Display
) -> Iterator[tuple[str, Job]]:
    if choice.name == "yoga":
        yield "yoga", workspace.ready_job("yoga", [], display)
        return
    inner = Workspace(folder)
    for file in _files(data_folder(workspace.root, choice.name), choice.only):
        params = {}
        if choice.name == "trials":
            shots = trial_shots(file, choice.videos)
        else:
            shots = protocol_shots(file, choice.sampling, choice.videos)
            params = {"sync": {"max_rate": RESAMPLED_MAX_RATE}}
        action = folder / "actions" / file.stem
        make_action(action, file.stem, shots, choice.detector, params)
        yield file.stem, inner.ready_job(str(action), [], display)


def _files(folder: Path, only: Sequence[str]) -> list[Path]:
    files = sorted(folder.glob("*.npz"))
    known = [file.stem for file in files]
    unknown = [name for name in only if name not in known]
    if unknown:
        raise WrongUse(f"--only {unknown[0]}: {folder} has {', '.join(known)}")
    return [file for file in files if not only or file.stem in only]
