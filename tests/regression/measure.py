"""The real pipeline, run as a user runs it, and what it scored."""

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from imocap_core.metrics.scoring import ALL_VIDEOS
from imocap_core.pipeline.source import PROJECT

DATA_VARIABLE = "IMOCAP_DATA"
REAL = "balance_beam"
MADE = "yoga"
LIMIT_S = 900  # a run that hangs fails here, not at the end of the patience of who waits for CI
# Pictures cost time and carry no number.
ALWAYS = ("evaluate.figures=false",)


@dataclass(frozen=True)
class Scored:
    """The numbers of one run, as its report's metrics.json lists them."""

    rows: Sequence[Mapping[str, str | float | None]]  # result, video, metric, value, note

    def summary(self) -> dict[str, dict[str, float]]:
        """result -> metric -> the value over all videos; what was not scored is absent."""
        found: dict[str, dict[str, float]] = {}
        for row in self.rows:
            if row["video"] == ALL_VIDEOS and row["value"] is not None:
                found.setdefault(str(row["result"]), {})[str(row["metric"])] = float(row["value"])
        return found

    def by_video(self, result: str, metric: str) -> dict[str, float]:
        """video -> value of one metric, where it was scored."""
        return {
            str(row["video"]): float(row["value"])
            for row in self.rows
            if (row["result"], row["metric"]) == (result, metric)
            and row["video"] != ALL_VIDEOS
            and row["value"] is not None
        }


def real_data() -> Path | None:
    """The folder of the real action, when this machine has it."""
    named = os.environ.get(DATA_VARIABLE)
    folder = (Path(named) if named else PROJECT.parent / "shared" / "data") / REAL
    return folder if (folder / "action.yaml").is_file() else None


def run_pipeline(root: Path, action: str | Path, sets: Sequence[str] = ()) -> Scored:
    """Run every stage of an action below `root` and read its scores.

    Two processes may ask for the same: the store's lock lets one work, the other finds everything
    cached. RuntimeError with what the pipeline said, when it failed.
    """
    settings = [word for value in (*ALWAYS, *sets) for word in ("--set", value)]
    command = [sys.executable, "-m", "stages", "--root", str(root), "run", str(action), *settings]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        command, cwd=PROJECT, env=environment, capture_output=True, text=True, timeout=LIMIT_S
    )
    if done.returncode:
        raise RuntimeError(f"imocap run {action} failed:\n{done.stdout}{done.stderr}")
    report = root / "artifacts" / Path(action).name / "report" / "metrics.json"
    return Scored(json.loads(report.read_text(encoding="utf-8"))["metrics"])
