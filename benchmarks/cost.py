"""`imocap benchmark cost`: what an action costs, as a function of its size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table
from scipy.optimize import nnls

from benchmarks.cost_action import ActionSize
from benchmarks.cost_stages import BookkeepingRow, StageCost, bookkeeping, measured
from benchmarks.names import BenchmarkOptions
from benchmarks.tables import ABSENT, DETAILS, markdown_table, write_rows, write_texts
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display
from imocap_core.workspace import Workspace

# A stage's cost as a sum of few terms in the number of videos, frames and keypoints.
#
#     cost = a + b V + c V T + d V T K + e P + f P T^2,  P = V (V - 1) / 2
#
# V videos of T frames with K keypoints, P pairs of videos; no coefficient is negative. Fitted to
# relative errors, as the sizes differ by a factor of forty (non-negative least squares, Lawson and
# Hanson 1974).

Size = tuple[int, int, int]  # videos, frames of each, keypoints
TERMS: dict[str, Callable[[int, int, int], float]] = {
    "fixed": lambda V, T, K: 1.0,
    "a video": lambda V, T, K: float(V),
    "a frame": lambda V, T, K: float(V * T),
    "a keypoint": lambda V, T, K: float(V * T * K),
    "a pair of videos": lambda V, T, K: V * (V - 1) / 2,
    "a pair of frames": lambda V, T, K: V * (V - 1) / 2 * float(T) ** 2,
}


@dataclass(frozen=True)
class CostModel:
    """Coefficients of TERMS, in the unit of the cost."""

    coefficients: Mapping[str, float]

    def at(self, size: Size) -> float:
        """The predicted cost."""
        return sum(self.coefficients[name] * term(*size) for name, term in TERMS.items())


def fitted(sizes: Sequence[Size], costs: Sequence[float]) -> CostModel:
    """The model with the least sum of squared relative errors.

    ValueError unless all costs are positive.
    """
    if not sizes or min(costs) <= 0:
        raise ValueError(f"costs: expected positive ones, got {list(costs)}")
    relative = np.array([[term(*size) for term in TERMS.values()] for size in sizes])
    relative /= np.asarray(costs)[:, None]
    scale = relative.max(axis=0)
    scaled, _ = nnls(relative / scale, np.ones(len(sizes)))
    return CostModel(dict(zip(TERMS, (scaled / scale).tolist(), strict=True)))


# The cost models of all stages, and of a whole action.

LEAST_S = 0.005  # the system counts processor time in hundredths


@dataclass(frozen=True)
class ActionCost:
    """A whole action: processor seconds, the process's largest memory, bytes of all results."""

    processor_s: float
    peak_mb: float
    stored_mb: float


@dataclass(frozen=True)
class CostModels:
    """Stage -> processor seconds, stored MB, and the process's largest memory meanwhile."""

    processor_s: dict[str, CostModel]
    stored_mb: dict[str, CostModel]
    peak_mb: dict[str, CostModel]

    def at(self, size: Size) -> ActionCost:
        """The predicted cost of an action."""
        return ActionCost(
            sum(model.at(size) for model in self.processor_s.values()),
            max(model.at(size) for model in self.peak_mb.values()),
            sum(model.at(size) for model in self.stored_mb.values()),
        )


def size_of(row: StageCost) -> Size:
    """Videos, frames of each, keypoints."""
    return row.videos, row.frames, row.keypoints


def of_actions(rows: Sequence[StageCost]) -> dict[Size, ActionCost]:
    """What each action cost."""
    sizes = dict.fromkeys(size_of(row) for row in rows)
    return {size: _summed([row for row in rows if size_of(row) == size]) for size in sizes}


def models_of(rows: Sequence[StageCost]) -> CostModels:
    """Fitted to the stages of several actions."""
    processor_s, stored_mb, peak_mb = {}, {}, {}
    for stage in dict.fromkeys(row.stage for row in rows):
        of_stage = [row for row in rows if row.stage == stage]
        sizes = [size_of(row) for row in of_stage]
        seconds = [max(row.processor_s, LEAST_S) for row in of_stage]
        processor_s[stage] = fitted(sizes, seconds)
        stored_mb[stage] = fitted(sizes, [row.stored_mb for row in of_stage])
        peak_mb[stage] = fitted(sizes, [row.peak_mb for row in of_stage])
    return CostModels(processor_s, stored_mb, peak_mb)


def _summed(rows: Sequence[StageCost]) -> ActionCost:
    return ActionCost(
        sum(row.processor_s for row in rows),
        max(row.peak_mb for row in rows),
        sum(row.stored_mb for row in rows),
    )


# What thousands of actions cost, from the model of one action and stated assumptions.

DETECTION_S = 0.078  # of a core for a frame with one person (docs/detection.md)
DETECTION_MB = 0.0016  # stored, of a frame with one person
MBIT_PER_S, FPS = 5.0, 30.0  # of the films that are kept with the actions
DOLLARS_A_CORE_HOUR, DOLLARS_A_GB_MONTH = 0.04, 0.02
CORES = 16  # of a machine


@dataclass(frozen=True)
class ScaleCost:
    """Of all actions together.

    detection_h, stages_h: core hours. memory_gb: of a worker. results_gb, films_gb: stored.
    core_dollars, month_dollars: price of the time, and of a month of storage.
    """

    actions: int
    detection_h: float
    stages_h: float
    memory_gb: float
    results_gb: float
    films_gb: float

    @property
    def core_h(self) -> float:
        """Core hours."""
        return self.detection_h + self.stages_h

    @property
    def core_dollars(self) -> float:
        """Price of the processor time."""
        return DOLLARS_A_CORE_HOUR * self.core_h

    @property
    def month_dollars(self) -> float:
        """Price of a month of storage."""
        return DOLLARS_A_GB_MONTH * (self.results_gb + self.films_gb)

    def hours(self, machines: int) -> float:
        """On so many machines of CORES cores that are always busy."""
        return self.core_h / (CORES * machines)


def scaled(models: CostModels, actions: int, size: Size) -> ScaleCost:
    """So many actions of one size, from pixels to their reports."""
    videos, frames, _ = size
    one = models.at(size)
    films_mb = videos * frames / FPS * MBIT_PER_S / 8
    detections_mb = DETECTION_MB * videos * frames
    return ScaleCost(
        actions,
        detection_h=actions * videos * frames * DETECTION_S / 3600,
        stages_h=actions * one.processor_s / 3600,
        memory_gb=one.peak_mb / 1e3,
        results_gb=actions * (one.stored_mb + detections_mb) / 1e3,
        films_gb=actions * films_mb / 1e3,
    )


# The cost models as tables in Markdown.

SECONDS = {"fixed": "s", "a video": "s", "a frame": "ms", "a keypoint": "µs"}
SECONDS |= {"a pair of videos": "s", "a pair of frames": "µs"}
MEGABYTES = {"fixed": "MB", "a video": "MB", "a frame": "kB", "a keypoint": "B"}
MEGABYTES |= {"a pair of videos": "MB", "a pair of frames": "B"}
FACTORS = {"s": 1.0, "ms": 1e3, "µs": 1e6, "MB": 1.0, "kB": 1e3, "B": 1e6}
SHOWN = (8, 300, 25)  # the size whose shares are shown


def model_table(models: Mapping[str, CostModel], units: Mapping[str, str]) -> str:
    """A row a stage: its coefficients, the cost of one size, and its share of all stages."""
    unit = units["fixed"]
    whole = sum(model.at(SHOWN) for model in models.values())
    head = ["stage", *(f"{name} ({units[name]})" for name in TERMS)]
    head += [f"{SHOWN[0]} x {SHOWN[1]} ({unit})", "share"]
    rows = []
    for stage, model in models.items():
        cells = [_coefficient(model.coefficients[n] * FACTORS[units[n]]) for n in TERMS]
        cost = model.at(SHOWN)
        rows.append([stage, *cells, f"{cost:.2f}", f"{100 * cost / whole:.0f} %"])
    return markdown_table(head, rows)


def prediction_table(
    actions: Mapping[Size, ActionCost], models: CostModels, held_out: Sequence[Size]
) -> str:
    """Measured, and what the model says, of every size."""
    head = ["videos x frames", "keypoints", "", "core seconds", "model", "peak (MB)", "model"]
    head += ["stored (MB)", "model"]
    rows = []
    for size, cost in actions.items():
        predicted = models.at(size)
        pairs = (
            (cost.processor_s, predicted.processor_s),
            (cost.peak_mb, predicted.peak_mb),
            (cost.stored_mb, predicted.stored_mb),
        )
        cells = [text for measured, model in pairs for text in _compared(measured, model)]
        kind = "held out" if size in held_out else "fitted"
        rows.append([f"{size[0]} x {size[1]}", str(size[2]), kind, *cells])
    return markdown_table(head, rows)


def scale_text(costs: Sequence[ScaleCost], size: Size, machines: int) -> str:
    """The extrapolation, with its assumptions."""
    head = ["actions", "detection (core h)", "stages (core h)", f"{machines} machines (h)"]
    head += ["processor ($)", "results (GB)", "films (GB)", "a month of storage ($)"]
    rows = [
        [
            f"{c.actions:,}",
            f"{c.detection_h:,.0f}",
            f"{c.stages_h:,.0f}",
            f"{c.hours(machines):.2g}",
            f"{c.core_dollars:,.0f}",
            f"{c.results_gb:,.0f}",
            f"{c.films_gb:,.0f}",
            f"{c.month_dollars:,.1f}",
        ]
        for c in costs
    ]
    assumed = (
        f"{size[0]} clips of {size[1]} frames an action, one person, films of {MBIT_PER_S:g} "
        f"Mbit/s at {FPS:g} frames/s; machines of {CORES} cores; {DOLLARS_A_CORE_HOUR:g} $ a core "
        f"hour, {DOLLARS_A_GB_MONTH:g} $ a GB and month; {costs[0].memory_gb:.1f} GB a worker."
    )
    return f"{assumed}\n\n{markdown_table(head, rows)}"


def bookkeeping_text(rows: Sequence[BookkeepingRow]) -> str:
    """What a task pays for the other actions of its folder, and the run once."""
    head = (
        "actions in the folder",
        "leftovers (ms)",
        "files.json (ms)",
        "once: cache's limit (ms)",
    )
    cells = [
        [f"{r.actions:,}", f"{r.sweep_ms:.1f}", f"{r.memory_ms:.1f}", f"{r.limit_ms:.0f}"]
        for r in rows
    ]
    each = 1e3 * (rows[-1].sweep_ms + rows[-1].memory_ms) / rows[-1].actions
    return f"{markdown_table(head, cells)}\n\n{each:.0f} µs a task for every action there."


def _coefficient(value: float) -> str:
    return ABSENT if value == 0 else f"{value:.3g}"


def _compared(measured: float, model: float) -> tuple[str, str]:
    return f"{measured:,.0f}", f"{100 * (model / measured - 1):+.0f} %"


NAME = "cost"
FITTED = (
    *(ActionSize(*size) for size in ((2, 100), (2, 300), (4, 150), (8, 150), (4, 600))),
    ActionSize(4, 150, "coco18"),
    ActionSize(16, 300),
    ActionSize(8, 1000),
)
HELD_OUT = (ActionSize(3, 400), ActionSize(6, 250))
ACTIONS, SIZE, MACHINES = (20, 1_000, 10_000), (8, 300, 25), 10


def report(options: BenchmarkOptions, workspace: Workspace, display: Display) -> list[Table | str]:
    """Measure what was not (`--only 4x150-body25` for some sizes), and fit."""
    names = {size.name: size for size in (*FITTED, *HELD_OUT)}
    for name in options.only:
        if name not in names:
            raise WrongUse(f"--only {name}: expected one of {', '.join(names)}")
    folder = workspace.root / "artifacts" / "benchmark" / NAME
    if options.only:
        rows = measured(folder, [names[name] for name in options.only])
        write_rows(folder, "some", rows)
        return [f"Measured: {', '.join(options.only)}", f"Written to {folder}"]
    text = text_of(folder)
    write_texts(folder, {"table.md": text})
    return [text, f"Written to {folder}"]


def text_of(folder: Path) -> str:
    """Measured and predicted costs, the models, and thousands of actions."""
    fitted_rows, held_out_rows = measured(folder, FITTED), measured(folder, HELD_OUT)
    write_rows(folder, "stages", [*fitted_rows, *held_out_rows])
    models = models_of(fitted_rows)
    actions = of_actions([*fitted_rows, *held_out_rows])
    held_out = [size_of(row) for row in held_out_rows]
    costs = [scaled(models, count, SIZE) for count in ACTIONS]
    parts = (
        "## Whole actions, measured and predicted",
        prediction_table(actions, models, held_out),
        "## Many actions",
        scale_text(costs, SIZE, MACHINES),
        DETAILS,
        "## Processor time of each stage",
        model_table(models.processor_s, SECONDS),
        "## Stored by each stage",
        model_table(models.stored_mb, MEGABYTES),
        "## What a task pays for the other actions of its folder",
        bookkeeping_text(bookkeeping(folder)),
    )
    return "\n\n".join(parts) + "\n"
