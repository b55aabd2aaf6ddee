"""Scores of every ablation on a set of actions, brought up to date, and their table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.ablations.sync_only import score_rival
from benchmarks.ablations.tables import Ablations, csv_text, json_text, markdown
from benchmarks.ablations.variants import VARIANTS, Variant, VariantRun, chosen_variants
from benchmarks.actions.choice import DATA, RESAMPLED, TITLES, Choice
from benchmarks.actions.prepare import action_names, chosen_names, existing_job, ready_job
from benchmarks.motion.measure import score_path
from benchmarks.parallel import ActionDisplay, each, was_interrupted
from benchmarks.scoring.score import cached_score, score_action
from benchmarks.scoring.score_file import ActionScore
from benchmarks.tables import write_texts
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

Scores = dict[str, ActionScore]  # by variant


def measure(
    workspace: Workspace, base: Choice, names: Sequence[str], display: Display, jobs: int = 1
) -> tuple[Ablations, Path]:
    """Run the variants `names` (all when empty) of an action set, write the tables after each
    action; them and their folder.

    Runs that share detector, sampling and videos share their artifacts, and runs of the plain
    benchmark are not repeated. WorkFailed at the end when something failed.
    """
    folder = base.folder(workspace.root).parent / f"ablations-{base.set_label}"
    every, chosen = action_names(workspace.root, base), chosen_names(workspace.root, base)
    variants = chosen_variants(base.name, names)
    by_action: dict[str, Scores] = {}
    for action in every:
        left_out = action not in chosen
        others = [v for v in VARIANTS if left_out or v not in variants]
        by_action[action] = _cached(workspace, base, action, others)
    tasks = [(name, (workspace.root, base, name, variants)) for name in chosen]
    faults = []
    for ended in each(one_action, tasks, jobs, display):
        if ended.result is None:
            faults.append(f"{ended.name}: {ended.fault}")
            continue
        scores, missed = ended.result
        by_action[ended.name] |= scores
        faults += [f"{ended.name}, {fault}" for fault in missed]
        write(_table(base, every, by_action), folder)
    if faults:
        raise WorkFailed("\n".join(faults))
    return _table(base, every, by_action), folder


def one_action(
    display: Display, root: Path, base: Choice, name: str, variants: Sequence[Variant]
) -> tuple[Scores, list[str]]:
    """The scores of one action by variant, and a sentence for each variant that failed."""
    scores: Scores = {}
    faults = []
    for variant in variants:
        try:
            variant_display = ActionDisplay(display, f"{name}, {variant.name}")
            scores[variant.name] = _score(variant_display, Workspace(root), base, name, variant)
        except WorkFailed as error:
            if was_interrupted(error):
                raise
            faults.append(f"{variant.name}: {error}")
    return scores, faults


def write(table: Ablations, folder: Path) -> None:
    """The three tables."""
    texts = {
        "table.md": markdown(table),
        "numbers.csv": csv_text(table),
        "numbers.json": json_text(table),
    }
    write_texts(folder, texts)


def choice_of(base: Choice, run: VariantRun) -> Choice:
    """The inputs of a run on the data of `base`."""
    return replace(base, detector=run.detector, videos=run.videos, outlier=run.outlier, only=())


def _score(
    display: Display, workspace: Workspace, base: Choice, name: str, variant: Variant
) -> ActionScore:
    choice = choice_of(base, variant.run)
    folder = choice.folder(workspace.root)
    job = ready_job(workspace, choice, name, variant.run.sets, display)
    file = score_path(folder, name, _scores_of(variant))
    if variant.is_rival:
        return score_rival(variant.result, job, display, file, folder / "costs")
    plain = not variant.run.sets and not variant.run.outlier
    return score_action(job, display, file, folder / "costs", with_oracle=plain)


def _cached(workspace: Workspace, base: Choice, name: str, variants: Sequence[Variant]) -> Scores:
    """The stored numbers that are still valid."""
    valid: Scores = {}
    by_file: dict[Path, ActionScore | None] = {}
    for variant in variants:
        choice = choice_of(base, variant.run)
        file = score_path(choice.folder(workspace.root), name, _scores_of(variant))
        if not file.is_file():
            continue
        if file not in by_file:
            job = existing_job(workspace, choice, name, variant.run.sets)
            code = [Path(__file__).with_name("sync_only.py")] if variant.is_rival else []
            by_file[file] = cached_score(job, file, *code)
        score = by_file[file]
        if score is not None:
            valid[variant.name] = score
    return valid


def _scores_of(variant: Variant) -> str:
    return variant.result if variant.is_rival else variant.run.label


def _table(base: Choice, every: Sequence[str], by_action: dict[str, Scores]) -> Ablations:
    command = f"imocap benchmark ablations --on {base.name}"
    if base.name in RESAMPLED:
        command += f" --sampling {base.sampling}"
    command += " --data FOLDER" if base.data is not None else ""
    by_variant = {
        variant.name: {a: by_action[a][variant.name] for a in every if variant.name in by_action[a]}
        for variant in chosen_variants(base.name, ())
    }
    return Ablations(
        f"Ablations. {TITLES[base.name]}", command, DATA[base.name], list(every), by_variant
    )
