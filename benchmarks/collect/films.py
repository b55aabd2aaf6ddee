"""The compilations that are measured, and the examples of their actions.

The defaults were chosen on other films: other actions, takes and transitions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from benchmarks.actions.captured import data_folder
from benchmarks.collect.edit import Piece
from benchmarks.collect.takes import Take, make_takes

SERVE, KICK = "trials/tennis_serve_jarua", "trials/cmu_soccer_kick_s10"
WALK, OTHER_WALK = "trials/cmu_walk_s07", "performers/cmu_walk_s08"
JUMP = "trials/cmu_jump_s13"
ACTION_OF = {SERVE: "serve", KICK: "kick", WALK: "walk", OTHER_WALK: "walk"}
WALKED = (0, 66)  # frames
TAKES = {
    "serve 0": Take(SERVE, 0, 0, room=0),
    "serve 1": Take(SERVE, 1, 1, room=1),
    "serve 2": Take(SERVE, 2, 2, room=2),
    "serve 3": Take(SERVE, 3, 3, room=3),
    "serve 4": Take(SERVE, 5, 0, room=0),
    "slow serve": Take(SERVE, 6, 4, room=1, slow=4),
    "kick 0": Take(KICK, 0, 1, room=1),
    "kick 1": Take(KICK, 1, 2, room=2),
    "kick 2": Take(KICK, 2, 3, room=3),
    "kick 3": Take(KICK, 3, 0, room=0),
    "walk 0": Take(WALK, 0, 0, room=0),
    "walk 1": Take(WALK, 1, 1, room=1),
    "walk 2": Take(WALK, 2, 3, room=3),
    "walk 3": Take(WALK, 4, 0, room=0),
    "walk 4": Take(OTHER_WALK, 0, 0, room=0, performer=1),
    "walk 5": Take(OTHER_WALK, 1, 5, room=1, performer=1),
    "walk 6": Take(OTHER_WALK, 2, 2, room=2, performer=1),
    "talk 0": Take(SERVE, 0, 0, room=2, talks=True),
    "talk 1": Take(OTHER_WALK, 0, 6, room=3, performer=1, talks=True),
    "jump 0": Take(JUMP, 0, 1, room=2),
    "jump 1": Take(JUMP, 1, 8, room=0),
}
EXAMPLES = {
    "serve": Take(SERVE, 4, 3, room=1),
    "kick": Take(KICK, 4, 1, room=3),
    "walk": Take(WALK, 3, 1, room=2),
}


@dataclass(frozen=True)
class PlannedPiece:
    """A piece as it is planned: `source` names a take, or a real video of the data folder; None is
    blank."""

    source: str | None
    piece: Piece


def planned(source: str | None, into: str = "cut", frames: int = 0, **how: Any) -> PlannedPiece:
    """A piece of a source; `how`: the other fields of `Piece`."""
    return PlannedPiece(source, Piece(None, into, frames, **how))


BROADCAST = (
    planned(None, length=20),
    planned("talk 0", caption="INTERVIEW", zoom=1.6),
    planned("serve 0"),
    planned("slow serve", "wipe", 10, step=4),
    planned("slow serve", "wipe", 10, span=(60, 260), caption="REPLAY"),
    planned("balance_beam/cam01", "wipe", 12, step=2),
    planned("walk 0", "dissolve", 12),
    planned("kick 0"),
    planned("walk 4", "fade", 10),
    planned("serve 1", letterbox=True),
    planned(None, length=9),
    planned("jump 0"),
    planned("kick 1", "dissolve", 16),
    planned("kick 0", "dissolve", 8, span=(15, 60), repeat=4, caption="SLOW MOTION"),
    planned("serve 3", mirrored=True),
    planned("crowd/cam02", "dissolve", 20, step=2),
    planned("serve 4"),
    planned("walk 1", "wipe", 14),
    planned("talk 1", "fade", 8, caption="COACH"),
    planned("kick 2", zoom=1.2),
)
HIGHLIGHTS = (
    planned("walk 5"),
    planned("walk 2", "dissolve", 10),
    planned("serve 2"),
    planned("balance_beam/cam03", "fade", 12, step=2),
    planned("serve 0", still=40),
    planned("serve 0", "dissolve", 10, zoom=1.15),
    planned("kick 3"),
    planned("jump 1", "wipe", 8),
    planned("walk 3"),
    planned("slow serve", "dissolve", 14, span=(80, 240), letterbox=True, caption="1/4"),
    planned("walk 6", "fade", 15),
    planned(None, length=6, level=250),
    planned("kick 1", mirrored=True),
    planned("balance_beam/cam04", "wipe", 18, step=2),
    planned("talk 0", zoom=2.2),
    planned("walk 0", "dissolve", 10, span=(5, 55), repeat=2),
    planned("serve 1", "fade", 8),
    planned("kick 2", flash=30),
)


@dataclass(frozen=True)
class Compilation:
    """Films as lists of pieces, and of each action an example: a take that no film shows."""

    films: dict[str, list[Piece]]
    examples: dict[str, Path]


def reported_films(root: Path, folder: Path) -> Compilation:
    """Two films, 35 shots in all: serves, kicks and walks, and what is shown between them."""
    files = make_takes(root, folder / "takes", [*TAKES.values(), *EXAMPLES.values()])
    films = {"broadcast": BROADCAST, "highlights": HIGHLIGHTS}
    return Compilation(
        {name: [_piece(plan, root, files) for plan in plans] for name, plans in films.items()},
        {name: files[take] for name, take in EXAMPLES.items()},
    )


def _piece(plan: PlannedPiece, root: Path, files: Mapping[Take, Path]) -> Piece:
    """The piece with its file, and what it shows: the action and the take."""
    if plan.source is None:
        return plan.piece
    if plan.source not in TAKES:
        return replace(plan.piece, file=_real_video(root, plan.source))
    take = TAKES[plan.source]
    action = None if take.talks else ACTION_OF.get(take.file)
    shown = None if action is None else f"{action}/{take.name}"
    span = plan.piece.span or (WALKED if action == "walk" else None)
    return replace(plan.piece, file=files[take], shown=shown, span=span)


def _real_video(root: Path, name: str) -> Path:
    """A real video of the data folder, as `balance_beam/cam01`."""
    kind, camera = name.split("/")
    return data_folder(root, "trials").parent / kind / "videos" / f"{camera}.mp4"
