"""`imocap push` and `pull`: an action into a store that several machines share, and from it."""

from __future__ import annotations

from typing import Annotated

import typer

from imocap_core.cli.json_output import print_json
from imocap_core.cli.options import ActionName, Json, SharedStore, root_of, speaker
from imocap_core.errors import WrongUse


def push_command(
    context: typer.Context,
    action: ActionName,
    store: SharedStore = None,
    replace: Annotated[
        bool, typer.Option("--replace", help="Where the store has another action of this name.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Copy an action and its results into a shared store."""
    from imocap_core.library.pushing import push

    pushed = push(action, store=_required(store), root=root_of(context), replace=replace)
    if as_json:
        print_json(pushed)
        return
    speaker(markup=False).print(
        f"{pushed.action}: {len(pushed.files)} files, {len(pushed.new_files)} of them new there; "
        f"results of {len(pushed.results)} stages."
    )


def pull_command(
    context: typer.Context,
    action: Annotated[str, typer.Argument(help="The name under which it was pushed.")],
    store: SharedStore = None,
    as_json: Json = False,
) -> None:
    """Copy an action and its results from a shared store."""
    from imocap_core.library.pulling import pull

    pulled = pull(action, store=_required(store), root=root_of(context))
    if as_json:
        print_json(pulled)
        return
    console = speaker(markup=False)
    state = "fetched" if pulled.new else "was here"
    console.print(f"{pulled.folder}: {state}; results of {len(pulled.results)} stages.")
    if pulled.missing:
        console.print(f"The store has no whole results of {', '.join(pulled.missing)}.")


def _required(store: str | None) -> str:
    if store is None:
        raise WrongUse("expected --store URL, or IMOCAP_STORE: where the shared store is")
    return store
