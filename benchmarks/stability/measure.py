"""Scores of every perturbed action, brought up to date."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchmarks.actions.action_folder import is_made
from benchmarks.actions.action_variant import ActionVariant
from benchmarks.parallel import ActionDisplay, LineDisplay, each, in_process, other_thread_count
from benchmarks.scoring.score import cached_score, score_action, truth_of
from benchmarks.scoring.score_file import LAST, ActionScore
from benchmarks.stability.pair_errors import pair_errors
from benchmarks.stability.perturbations import Perturbation
from benchmarks.stability.sources import (
    ACTIONS,
    existing_source,
    is_detected,
    perturbations_of,
    ready_source,
)
from benchmarks.stability.tables import ActionStability, VariantScore, markdown
from benchmarks.stability.variants import make_variant, variant_key
from benchmarks.tables import write_texts
from imocap_core.artifacts.schemas import Keypoints, RefineSync
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace

NAME = "stability"


@dataclass(frozen=True)
class PerturbedAction(ActionVariant):
    """One perturbation of one action, below the benchmark's folder."""

    perturbation: Perturbation

    @property
    def variant(self) -> str:
        """The name of the perturbation."""
        return self.perturbation.name

    def job(self) -> Job:
        """Its job. Results are cached by their inputs, so that another number of threads needs a
        store of its own."""
        is_apart = self.perturbation.has_other_threads
        root = self.folder / self.perturbation.name if is_apart else self.folder
        return Workspace(root).job(str(self.action_folder), [])


def chosen_actions(only: tuple[str, ...]) -> list[str]:
    """The actions to run; WrongUse when `only` names one that does not exist."""
    unknown = [name for name in only if name not in ACTIONS]
    if unknown:
        raise WrongUse(f"--only {unknown[0]}: expected one of {', '.join(ACTIONS)}")
    return [name for name in ACTIONS if not only or name in only]


def measure(
    workspace: Workspace, only: tuple[str, ...], display: Display, jobs: int = 1
) -> tuple[str, Path]:
    """Run what is not finished and write the table after every variant; it and its folder.

    Actions not chosen are shown where their stored numbers are valid. An action whose data or
    detector are not here is named in the table. WorkFailed, after all others have run, when no
    chosen action can be run; a variant that fails is named in the table.
    """
    folder, chosen = workspace.root / "artifacts" / "benchmark" / NAME, chosen_actions(only)
    actions = {name: ActionStability(name) for name in ACTIONS}
    tasks = []
    for name in ACTIONS:
        variants = [PerturbedAction(folder, name, p) for p in perturbations_of(name)]
        if name not in chosen:
            actions[name] = _stored(workspace, name, variants)
            continue
        try:
            source = ready_source(workspace, name, display)
        except WorkFailed as fault:
            actions[name] = ActionStability(name, not_measured=str(fault))
            continue
        tasks += [(variant.name, (variant, source)) for variant in variants]
    if not tasks:
        raise WorkFailed("\n".join(f"{n}: {actions[n].not_measured}" for n in chosen))
    variant_of = {name: arguments[0] for name, arguments in tasks}
    for ended in each(one_variant, tasks, jobs, display):
        variant = variant_of[ended.name]
        title = variant.perturbation.title
        score = ended.result or VariantScore(title, {}, fault=ended.fault)
        actions[variant.action].scores.append(score)
        write_texts(folder, {"table.md": markdown(_in_order(actions))})
    return markdown(_in_order(actions)), folder


def one_variant(display: Display, variant: PerturbedAction, source: Path) -> VariantScore:
    """Bring one variant up to date and score it."""
    if variant.perturbation.has_other_threads:
        return in_process(_scored, (LineDisplay(), variant, source), other_thread_count())
    return _scored(display, variant, source)


def _scored(display: Display, variant: PerturbedAction, source: Path) -> VariantScore:
    action_display = ActionDisplay(display, variant.name)
    detected = is_detected(variant.action)
    if not is_made(variant.action_folder, variant_key(source, variant.perturbation, detected)):
        action_display.started("perturb", [f"{variant.perturbation.title} is not made"])
        make_variant(variant.action_folder, source, variant.perturbation, detected)
    root = variant.job().store.folder.parent
    job = Workspace(root).ready_job(str(variant.action_folder), [], action_display)
    costs = variant.folder / "costs"
    score = score_action(job, action_display, variant.score_file, costs, with_oracle=False)
    return variant_score(variant.perturbation.title, job, score)


def _stored(workspace: Workspace, name: str, variants: list[PerturbedAction]) -> ActionStability:
    """An action's valid numbers, nothing run."""
    source = existing_source(workspace, name)
    action = ActionStability(name, not_measured="not run on this code")
    if source is None:
        return action
    for variant in variants:
        key = variant_key(source, variant.perturbation, is_detected(name))
        if variant.score_file.is_file() and is_made(variant.action_folder, key):
            job = variant.job()
            score = cached_score(job, variant.score_file)
            if score is not None:
                action.scores.append(variant_score(variant.perturbation.title, job, score))
    return action


def variant_score(title: str, job: Job, score: ActionScore) -> VariantScore:
    """The result of a scored action: means over its videos, and errors over all pairs of them."""
    stored = [job.store.load(job.action.name, stage) for stage in ("keypoints", LAST)]
    assert stored[0] is not None, "a scored action has its artifacts"
    assert stored[1] is not None
    keypoints, refined = stored[0].decode(Keypoints), stored[1].decode(RefineSync)
    sync, truth = refined.sync, truth_of(job, keypoints)
    pairs = pair_errors(refined.motion.cameras, sync, keypoints, truth)
    return VariantScore(
        title,
        score.numbers["after loop"] | pairs,
        sync.reference,
        tuple(sync.excluded),
        tuple(sync.mirrored),
    )


def _in_order(actions: dict[str, ActionStability]) -> list[ActionStability]:
    """Actions in the order of ACTIONS, each one's variants in the order of its perturbations."""
    for name, action in actions.items():
        titles = [perturbation.title for perturbation in perturbations_of(name)]
        action.scores.sort(key=lambda score: titles.index(score.title))
    return [actions[name] for name in ACTIONS]
