"""The compilations that are measured, and the examples of their actions.

The defaults were chosen on the other films of `tuning_films`: other actions, takes and transitions.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchmarks.actions.captured import data_folder
from benchmarks.collect.edit import Piece
from benchmarks.collect.takes import Take, make_takes

SERVE, KICK = "trials/tennis_serve_jarua", "trials/cmu_soccer_kick_s10"
WALK, OTHER_WALK = "trials/cmu_walk_s07", "performers/cmu_walk_s08"
JUMP = "trials/cmu_jump_s13"
ACTION_OF = {SERVE: "serve", KICK: "kick", WALK: "walk", OTHER_WALK: "walk"}
WALKED = (0, 66)  # frames


@dataclass(frozen=True)
class Compilation:
    """Films as lists of pieces, and of each action an example: a take that no film shows."""

    films: dict[str, list[Piece]]
    examples: dict[str, Path]
    takes: dict[Path, Take]


def reported_films(root: Path, folder: Path) -> Compilation:
    """Two films of 35 shots: serves, kicks and walks, and what is about them in a broadcast."""
    serve = [Take(SERVE, t, p, room=p % 4) for t, p in ((0, 0), (1, 1), (2, 2), (3, 3), (5, 0))]
    slow_serve = Take(SERVE, 6, 4, room=1, slow=4)
    kick = [Take(KICK, t, p, room=p % 4) for t, p in ((0, 1), (1, 2), (2, 3), (3, 0))]
    walk = [Take(WALK, t, p, room=p % 4) for t, p in ((0, 0), (1, 1), (2, 3), (4, 0))]
    walk += [Take(OTHER_WALK, t, p, room=p % 4, performer=1) for t, p in ((0, 0), (1, 5), (2, 2))]
    talks = [
        Take(SERVE, 0, 0, room=2, talks=True),
        Take(OTHER_WALK, 0, 6, room=3, performer=1, talks=True),
    ]
    jump = [Take(JUMP, 0, 1, room=2), Take(JUMP, 1, 8, room=0)]
    examples = {"serve": Take(SERVE, 4, 3, room=1), "kick": Take(KICK, 4, 1, room=3)}
    examples["walk"] = Take(WALK, 3, 1, room=2)
    every = [*serve, slow_serve, *kick, *walk, *talks, *jump, *examples.values()]
    files = make_takes(root, folder / "takes", every)

    def cut(take: Take, into: str = "cut", frames: int = 0, **how: object) -> Piece:
        shown = None if take.talks else ACTION_OF.get(take.file)
        span = {"span": WALKED} if shown == "walk" else {}
        label = None if shown is None else f"{shown}/{take.name}"
        return Piece(files[take], into, frames, shown=label, **(span | how))  # type: ignore[arg-type]

    real = [data_folder_video(root, name) for name in ("balance_beam/cam01", "crowd/cam02")]
    real += [data_folder_video(root, name) for name in ("balance_beam/cam03", "balance_beam/cam04")]
    first = [
        Piece(None, length=20),
        cut(talks[0], caption="INTERVIEW", zoom=1.6),
        cut(serve[0]),
        cut(slow_serve, "wipe", 10, step=4),
        cut(slow_serve, "wipe", 10, span=(60, 260), caption="REPLAY"),
        Piece(real[0], "wipe", 12, step=2),
        cut(walk[0], "dissolve", 12),
        cut(kick[0]),
        cut(walk[4], "fade", 10),
        cut(serve[1], letterbox=True),
        Piece(None, length=9),
        cut(jump[0]),
        cut(kick[1], "dissolve", 16),
        cut(kick[0], "dissolve", 8, span=(15, 60), repeat=4, caption="SLOW MOTION"),
        cut(serve[3], mirrored=True),
        Piece(real[1], "dissolve", 20, step=2),
        cut(serve[4]),
        cut(walk[1], "wipe", 14),
        cut(talks[1], "fade", 8, caption="COACH"),
        cut(kick[2], zoom=1.2),
    ]
    second = [
        cut(walk[5]),
        cut(walk[2], "dissolve", 10),
        cut(serve[2]),
        Piece(real[2], "fade", 12, step=2),
        cut(serve[0], still=40),
        cut(serve[0], "dissolve", 10, zoom=1.15),
        cut(kick[3]),
        cut(jump[1], "wipe", 8),
        cut(walk[3]),
        cut(slow_serve, "dissolve", 14, span=(80, 240), letterbox=True, caption="1/4"),
        cut(walk[6], "fade", 15),
        Piece(None, length=6, level=250),
        cut(kick[1], mirrored=True),
        Piece(real[3], "wipe", 18, step=2),
        cut(talks[0], zoom=2.2),
        cut(walk[0], "dissolve", 10, span=(5, 55), repeat=2),
        cut(serve[1], "fade", 8),
        cut(kick[2], flash=30),
    ]
    shown = {files[take]: take for take in every}
    return Compilation(
        {"broadcast": first, "highlights": second},
        {name: files[take] for name, take in examples.items()},
        shown,
    )


def data_folder_video(root: Path, name: str) -> Path:
    """A real video of the data folder, as `balance_beam/cam01`."""
    kind, camera = name.split("/")
    return data_folder(root, "trials").parent / kind / "videos" / f"{camera}.mp4"
