"""What is cached of an action, what would run, and why."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from imocap_core.artifacts.file_memory import remembered
from imocap_core.errors import WrongUse
from imocap_core.library.door import plain_errors
from imocap_core.library.one_off import Params, one_off
from imocap_core.pipeline import runner
from imocap_core.pipeline.recipe import Recipe
from imocap_core.pipeline.runner import Job, StageStatus
from imocap_core.workspace import Workspace

if TYPE_CHECKING:
    from imocap_core.artifacts.store import Stored


@dataclass(frozen=True)
class Explanation:
    """Everything that a stage's result depends on.

    missing: inputs that have not been made yet; then there is no recipe.
    """

    status: StageStatus
    missing: list[str]
    recipe: Recipe | None


@plain_errors
def status(
    action: str | Path,
    *,
    root: str | Path = ".",
    params: Params = None,
    store: str | None = None,
) -> list[StageStatus]:
    """For every stage whether its result is cached, and if not, why it would run.

    store: URL or folder of a shared store; results that are there are fetched.
    """
    workspace = Workspace(Path(root), store)
    return list(runner.stage_statuses(workspace.job(str(action), one_off(params))))


@plain_errors
def explain(
    action: str | Path, stage: str, *, root: str | Path = ".", params: Params = None
) -> Explanation:
    """Everything that a stage's result depends on, and what has changed since it was made."""
    job = Workspace(Path(root)).job(str(action), one_off(params))
    upstream(job, stage)
    done = {}
    for current in runner.stage_statuses(job):
        if current.stage == stage:
            break
        if current.stored is not None:
            done[current.stage] = current.stored
    missing = [name for name in job.pipeline.stages[stage].inputs if name not in done]
    return Explanation(current, missing, None if missing else job.recipe(stage, done))


@plain_errors
def verdict(
    action: str | Path, *, root: str | Path = ".", params: Params = None
) -> dict[str, Any] | None:
    """The verdict on an action's results as plain data; None where the motion would run again."""
    job = Workspace(Path(root)).job(str(action), one_off(params))
    stored = stored_of(runner.stage_statuses(job))
    if "refine_sync" not in stored:
        return None
    from imocap_core.result.artifacts import artifacts_of_stages
    from imocap_core.result.verdict import verdict_of_artifacts
    from imocap_core.verdict.verdict_file import verdict_document

    judged = verdict_of_artifacts(artifacts_of_stages(job.action.name, stored))
    return None if judged is None else verdict_document(judged)


def stored_of(statuses: Iterable[StageStatus]) -> dict[str, Stored]:
    """The cached results by stage."""
    return {s.stage: s.stored for s in statuses if s.stored is not None}


def left_out_of(stored: Mapping[str, Stored]) -> dict[str, str]:
    """The videos that these results' keypoints leave out as unusable, and why."""
    result = stored.get("keypoints")
    if result is None or result.schema != "Keypoints":
        return {}

    def read(_: Path) -> dict[str, str]:
        from imocap_core.artifacts.schemas import Keypoints

        return {video.id: video.reason for video in result.decode(Keypoints).left_out or []}

    return remembered("left_out", result.file, read)


def left_out_notes(stored: Mapping[str, Stored]) -> list[str]:
    """A sentence for each of them."""
    return [f"{video} is left out: {reason}" for video, reason in left_out_of(stored).items()]


def upstream(job: Job, stage: str) -> list[str]:
    """A stage and all that it needs, in running order. WrongUse for an unknown stage."""
    if stage not in job.pipeline.stages:
        raise WrongUse(f"no stage {stage!r}; there are: {', '.join(job.pipeline.stages)}")
    return job.pipeline.upstream(stage)
