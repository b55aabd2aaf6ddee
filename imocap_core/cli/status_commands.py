"""`imocap status` and `explain`: what is cached, and why something would run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import (
    ActionName,
    Json,
    Sets,
    SharedStore,
    StageName,
    root_of,
    speaker,
)

if TYPE_CHECKING:
    from imocap_core.library.status import Explanation

MAX_REASONS = 3


def status_command(
    context: typer.Context,
    action: ActionName,
    sets: Sets = [],  # noqa: B006
    store: SharedStore = None,
    as_json: Json = False,
) -> None:
    """Show which stages are cached, and why others would run."""
    from imocap_core.library.status import left_out_notes, left_out_of, status, stored_of, verdict

    stages = status(action, root=root_of(context), params=sets, store=store)
    stored = stored_of(stages)
    if as_json:
        rows = [
            {
                "stage": stage.stage,
                "state": stage.state,
                "why": stage.why,
                "digest": None if stage.stored is None else stage.stored.digest,
            }
            for stage in stages
        ]
        judged = verdict(action, root=root_of(context), params=sets)
        names = [
            {"video": video, "reason": reason} for video, reason in left_out_of(stored).items()
        ]
        print_json({"action": action, "stages": rows, "left_out": names, "verdict": judged})
        return
    from rich.markup import escape

    console = speaker()
    for stage in stages:
        if stage.stored is not None:
            state = f"[dim]cached     {stage.stored.digest[:12]}[/]"
        else:
            state = f"would run  {escape(reasons(stage.why))}"
        console.print(f"{stage.stage:<14} {state}")
    for note in left_out_notes(stored):
        console.print(escape(note))


def explain_command(
    context: typer.Context,
    action: ActionName,
    stage: StageName,
    sets: Sets = [],  # noqa: B006
    as_json: Json = False,
) -> None:
    """Show all that a stage's result depends on, and what changed."""
    from imocap_core.library.status import explain

    explanation = explain(action, stage, root=root_of(context), params=sets)
    if as_json:
        print_json({"action": action, "stage": stage} | _document(explanation))
    else:
        _print(stage, explanation)


def _document(explanation: Explanation) -> dict[str, object]:
    recipe = explanation.recipe
    parts: dict[str, object] = {
        "state": explanation.status.state,
        "why": explanation.status.why,
        "missing": explanation.missing,
    }
    if recipe is not None:
        parts |= {
            "key": recipe.key,
            "seed": recipe.seed,
            "inputs": recipe.inputs,
            "reads": recipe.reads,
            "code": recipe.code,
            "params": recipe.params,
        }
    return parts


def _print(stage: str, explanation: Explanation) -> None:
    console = speaker(markup=False)
    console.print(f"{stage}: {explanation.status.state}")
    recipe = explanation.recipe
    if recipe is None:
        console.print(f"  after {', '.join(explanation.missing)}")
        return
    for why in explanation.status.why:
        console.print(f"  because {why}")
    console.print(f"key     {recipe.key}\nseed    {recipe.seed}")
    for title, leaves in (("input", recipe.inputs), ("read", recipe.reads), ("code", recipe.code)):
        for name, digest in leaves.items():
            console.print(f"{title:<7} {digest[:12]}  {name}")
    for group, values in recipe.params.items():
        for name, value in values.items():
            console.print(f"param   {group}.{name} = {value}")


def reasons(why: list[str]) -> str:
    """The first few reasons, and how many more there are."""
    more = len(why) - MAX_REASONS
    return "; ".join(why[:MAX_REASONS]) + (f"; and {more} more" if more > 0 else "")
