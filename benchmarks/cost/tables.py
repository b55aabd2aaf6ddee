"""The cost models as tables in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from benchmarks.cost.bookkeeping import BookkeepingRow
from benchmarks.cost.model import TERMS, CostModel, Size
from benchmarks.cost.models import ActionCost, CostModels
from benchmarks.cost.scale import (
    CORES,
    DOLLARS_A_CORE_HOUR,
    DOLLARS_A_GB_MONTH,
    FPS,
    MBIT_PER_S,
    ScaleCost,
)
from benchmarks.tables import ABSENT, markdown_table

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
