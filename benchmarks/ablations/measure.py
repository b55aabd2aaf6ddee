"""`imocap benchmark ablations`: what each part of the method is worth, one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.ablations.sync_only import score_rival
from benchmarks.ablations.tables import Ablations, csv_text, json_text, markdown
from benchmarks.ablations.variants import VARIANTS, Run, Variant, chosen_variants
from benchmarks.actions.choice import DATA, RESAMPLED, TITLES, Choice
from benchmarks.actions.prepare import action_names, chosen_names, ready_job, standing_job
from benchmarks.motion.measure import kept_file
from benchmarks.parallel import Named, each, was_stopped
from benchmarks.scoring.score import score_action, standing_score
from benchmarks.scoring.score_file import ActionScore
from imocap_core.errors import WorkFailed
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

Scores = dict[str, ActionScore]  # by variant


def measure(
    workspace: Workspace, base: Choice, names: Sequence[str], display: Display, jobs: int = 1
) -> tuple[Ablations, Path]:
    """Run the variants `names` (all when empty) of an action set, write the tables after each
    action; them and their folder.

    Runs that share detector, sampling and videos share their artifacts, and runs that were done by
    the plain benchmark are not done again. WorkFailed at the end when something could not be done.
    """
    folder = base.folder(workspace.root).parent / f"ablations-{base.set_label}"
    every, wanted = action_names(workspace.root, base), chosen_names(workspace.root, base)
    variants = chosen_variants(base.name, names)
    found: dict[str, Scores] = {}
    for action in every:
        left_out = action not in wanted
        others = [v for v in VARIANTS if left_out or v not in variants]
        found[action] = _standing(workspace, base, action, others)
    tasks = [(name, (workspace.root, base, name, variants)) for name in wanted]
    faults = []
    for ended in each(one_action, tasks, jobs, display):
        if ended.made is None:
            faults.append(f"{ended.name}: {ended.fault}")
            continue
        scores, missed = ended.made
        found[ended.name] |= scores
        faults += [f"{ended.name}, {fault}" for fault in missed]
        write(_table(base, every, found), folder)
    if faults:
        raise WorkFailed("\n".join(faults))
    return _table(base, every, found), folder


def one_action(
    display: Display, root: Path, base: Choice, name: str, variants: Sequence[Variant]
) -> tuple[Scores, list[str]]:
    """All variants of one action, and a sentence for each that could not be done."""
    scores: Scores = {}
    faults = []
    for variant in variants:
        try:
            named = Named(display, f"{name}, {variant.name}")
            scores[variant.name] = _score(named, Workspace(root), base, name, variant)
        except WorkFailed as error:
            if was_stopped(error):
                raise
            faults.append(f"{variant.name}: {error}")
    return scores, faults


def write(table: Ablations, folder: Path) -> None:
    """The three tables."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (
        ("table.md", markdown(table)),
        ("numbers.csv", csv_text(table)),
        ("numbers.json", json_text(table)),
    ):
        (folder / name).write_text(text, encoding="utf-8")


def choice_of(base: Choice, run: Run) -> Choice:
    """The inputs of a run of the data in `base`."""
    return replace(base, detector=run.detector, videos=run.videos, outlier=run.outlier, only=())


def _score(
    display: Display, workspace: Workspace, base: Choice, name: str, variant: Variant
) -> ActionScore:
    choice = choice_of(base, variant.run)
    folder = choice.folder(workspace.root)
    job = ready_job(workspace, choice, name, variant.run.sets, display)
    file = kept_file(folder, name, _scores_of(variant))
    if variant.is_rival:
        return score_rival(variant.result, job, display, file, folder / "costs")
    plain = not variant.run.sets and not variant.run.outlier
    return score_action(job, display, file, folder / "costs", with_oracle=plain)


def _standing(workspace: Workspace, base: Choice, name: str, variants: Sequence[Variant]) -> Scores:
    """The kept numbers that are still valid."""
    found: Scores = {}
    seen: dict[Path, ActionScore | None] = {}
    for variant in variants:
        choice = choice_of(base, variant.run)
        file = kept_file(choice.folder(workspace.root), name, _scores_of(variant))
        if not file.is_file():
            continue
        if file not in seen:
            job = standing_job(workspace, choice, name, variant.run.sets)
            code = [Path(__file__).with_name("sync_only.py")] if variant.is_rival else []
            seen[file] = standing_score(job, file, *code)
        score = seen[file]
        if score is not None:
            found[variant.name] = score
    return found


def _scores_of(variant: Variant) -> str:
    return variant.result if variant.is_rival else variant.run.label


def _table(base: Choice, every: Sequence[str], found: dict[str, Scores]) -> Ablations:
    command = f"imocap benchmark ablations --on {base.name}"
    if base.name in RESAMPLED:
        command += f" --sampling {base.sampling}"
    command += " --data FOLDER" if base.data is not None else ""
    by_variant = {
        variant.name: {a: found[a][variant.name] for a in every if variant.name in found[a]}
        for variant in chosen_variants(base.name, ())
    }
    return Ablations(
        f"Ablations. {TITLES[base.name]}", command, DATA[base.name], list(every), by_variant
    )
