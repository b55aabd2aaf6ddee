"""`imocap benchmark moving_camera`: are cameras that walk told, and followed?"""

from __future__ import annotations

from itertools import product

from rich.table import Table

from benchmarks.moving_camera.films import film_count, film_row
from benchmarks.moving_camera.motions import CASES, SEEDS, motion_row
from benchmarks.moving_camera.tables import markdown
from benchmarks.names import BenchmarkOptions, table_of_rows
from benchmarks.tables import write_rows, write_texts
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

NAME, PARTS = "moving_camera", ("films", "motions")


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """Detection and paths on small films (`--only films`), motions through the pipeline
    (`--only motions`), or both; `--videos` films of each kind in each room."""
    for part in options.only:
        if part not in PARTS:
            raise WrongUse(f"--only {part}: expected one of {', '.join(PARTS)}")
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    films, motions = [], []
    if not options.only or "films" in options.only:
        count = film_count(options.videos)
        for number in range(count):
            display.progress(number / count, f"film {number + 1} of {count}")
            films.append(film_row(number))
        write_rows(folder, "films", films)
    if not options.only or "motions" in options.only:
        for seed, case in product(SEEDS, CASES):
            motions.append(motion_row(display, workspace.root, seed, case))
    text = markdown(films, motions)
    write_texts(folder, {"table.md": text})
    shown = [table_of_rows(films)] if films else []
    return [text, *shown, f"Written to {folder}"]
