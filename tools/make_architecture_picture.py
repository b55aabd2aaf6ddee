"""Draw docs/images/architecture.svg and write the way from a stage to the residual into
docs/architecture.md, both from the code: `python -m tools.make_architecture_picture`.

Above, the stages of pipeline.yaml with what each reads and writes; below, the rooms of the code in
the order of the import contract in pyproject.toml, with their number of lines. Names, order, files,
descriptions and counts all come from the code; the same code gives the same bytes.
"""

from __future__ import annotations

import ast
import re
import textwrap
import tomllib
from dataclasses import dataclass
from pathlib import Path

import grimp
import yaml

from tools.svg import INK, MONO, PALE, PAPER, SANS, arrow, box, fitted, text

ROOT = Path(__file__).resolve().parents[1]
ROOM_CONTRACT = "Each room imports only from those below it"
TARGET = ROOT / "docs" / "images" / "architecture.svg"

PAGE = ROOT / "docs" / "architecture.md"
# From a stage to the residual: each file, and where in it the calls go on to the next.
CHAIN = (
    ("stages/smpl_ba.py", "run"),
    ("imocap_core/motion/multiview/smpl_ba.py", "solve_jointly"),
    ("imocap_core/motion/multiview/common_motion.py", "fit_in_stages"),
    ("imocap_core/motion/gauss_newton.py", "gauss_newton"),
    ("imocap_core/motion/terms/reprojection.py", "Reprojection.add_to"),
)

WIDTH, MARGIN, GUTTER = 1280, 28, 128
# Title, first room in the contract's order, what its rooms may do, fill, edge.
BANDS = (
    ("Entrances", "benchmarks", "what a person calls", "#eef2f7", "#8aa0bc"),
    ("Showing", "compare", "files for people and programs", "#edf5ee", "#86ae8b"),
    ("Running", "workspace", "reading, solving, storing", "#fdf3e3", "#d3a860"),
    ("Pure", "synthetic", "arrays in, arrays out", "#f6edf3", "#b98aa8"),
    ("Foundation", "params", "imported by all", "#f1f1ef", "#a3a39b"),
)
FLOW = (
    "#3b6ea5",
    "#3f86a8",
    "#3f9a94",
    "#c98a2d",
    "#c2613f",
    "#b0405a",
    "#9d4d7c",
    "#8a5a9e",
    "#5f6470",
)


@dataclass(frozen=True)
class StageBox:
    """One stage: its place in the flow, what it reads of the action, what it makes."""

    name: str
    column: int
    says: str
    paper: str
    inputs: tuple[str, ...]
    reads: tuple[str, ...]
    artifact: str


@dataclass(frozen=True)
class RoomBox:
    """One package or module: its docstring's first line and its number of lines."""

    name: str
    says: str
    lines: int


def stages_of_code() -> list[StageBox]:
    """The stages of pipeline.yaml; a stage's column is its longest way from the first one."""
    graph = yaml.safe_load((ROOT / "pipeline.yaml").read_text(encoding="utf-8"))["stages"]
    columns: dict[str, int] = {}
    made = []
    for name, spec in graph.items():
        columns[name] = 1 + max((columns[given] for given in spec["inputs"]), default=-1)
        tree = ast.parse((ROOT / spec["script"]).read_text(encoding="utf-8"))
        (run,) = (n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == "run")
        says, _, paper = first_line(tree).partition(" (")
        artifact = ast.unparse(run.returns)
        inputs, reads = tuple(spec["inputs"]), tuple(spec["reads"])
        made.append(StageBox(name, columns[name], says, paper.rstrip(")"), inputs, reads, artifact))
    return made


def rooms_of_code() -> list[list[RoomBox]]:
    """The rooms of every band, top layer first, as the import contract orders them."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = settings["tool"]["importlinter"]
    modules = grimp.build_graph(*contract["root_packages"], cache_dir=None).modules
    (layers,) = (c["layers"] for c in contract["contracts"] if c["name"] == ROOM_CONTRACT)
    names = [name for layer in layers for name in re.findall(r"[\w.]+", layer)]
    rooms = [room_of_code(name) for name in names if name in modules]
    missing = {m for m in modules if m.count(".") == 1 and m.startswith("imocap_core.")}
    assert missing <= set(names), f"not in the import contract: {missing - set(names)}"
    starts = [[room.name for room in rooms].index(first) for _, first, *_ in BANDS]
    return [rooms[a:b] for a, b in zip(starts, [*starts[1:], len(rooms)], strict=True)]


def room_of_code(module: str) -> RoomBox:
    """A package with all that is in it, or a single module."""
    path = ROOT.joinpath(*module.split("."))
    files = sorted(path.rglob("*.py")) if path.is_dir() else [path.with_suffix(".py")]
    top = path / "__init__.py" if path.is_dir() else files[0]
    says = first_line(ast.parse(top.read_text(encoding="utf-8")))
    count = sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)
    return RoomBox(module.removeprefix("imocap_core."), says, count)


def first_line(tree: ast.Module) -> str:
    """The first line of a module's docstring, without full stop, backticks and a name before it."""
    line = (ast.get_docstring(tree) or "").partition("\n")[0].replace("`", "").rstrip(".")
    return re.sub(r"^(?:(?:[\w-]+ )?[\w-]+: )+", "", line)


def picture(stages: list[StageBox], bands: list[list[RoomBox]]) -> str:
    """The whole drawing."""
    flow, below = drawn_flow(stages, 96)
    walls, end = drawn_rooms(bands, below + 74)
    total = sum(room.lines for band in bands for room in band)
    parts = [
        text(MARGIN, 44, "From videos to motion: the stages", 21, weight=600),
        text(MARGIN, 66, "Each stage is one script. It reads artifacts and what the action "
             "declares (above it), and writes one artifact (below it).", 13, PALE),
        *flow,
        text(MARGIN, below + 28, "The code: rooms, top layer first", 21, weight=600),
        text(MARGIN, below + 50, "A room imports only from rooms that come after it. "
             f"Bars and numbers: lines of Python, {total:,} in all.", 13, PALE),
        *walls,
    ]  # fmt: skip
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {end + MARGIN:g}" '
        f'width="{WIDTH}" height="{end + MARGIN:g}" font-family="{SANS}" fill="{INK}">',
        "<title>The stages of imocap and the rooms of its code</title>",
        "<!-- made by tools/make_architecture_picture.py; don't edit -->",
        f'<rect width="{WIDTH}" height="{end + MARGIN:g}" rx="14" fill="{PAPER}"/>',
        *parts, "</svg>", "",
    ])  # fmt: skip


def drawn_flow(stages: list[StageBox], top: float) -> tuple[list[str], float]:
    """The stages in columns, those of one column below each other; the y where they end."""
    columns = max(stage.column for stage in stages) + 1
    pitch = (WIDTH - 2 * MARGIN + 22) / columns
    wide, high, gap = pitch - 22, 122, 30
    most = max(sum(s.column == c for s in stages) for c in range(columns))
    tall = most * (high + gap) - gap
    places = {}
    for stage in stages:
        beside = [s.name for s in stages if s.column == stage.column]
        block = len(beside) * (high + gap) - gap
        y = top + (tall - block) / 2 + beside.index(stage.name) * (high + gap)
        places[stage.name] = (MARGIN + stage.column * pitch, y)
    parts = []
    for stage in stages:
        x, y = places[stage.name]
        before = [s for s in stages if s.name in stage.inputs and s.column == stage.column - 1]
        for given in before:
            parts.append(arrow(x - 22, places[given.name][1] + high / 2, x - 2, y + high / 2))
        parts += drawn_stage(stage, x, y, wide, high)
    return parts, top + tall + 40


def drawn_stage(stage: StageBox, x: float, y: float, wide: float, high: float) -> list[str]:
    """What it reads of the action, the script with its description, the artifact."""
    color = FLOW[stage.column % len(FLOW)]
    centre = x + wide / 2
    parts = []
    if stage.reads:
        lines = textwrap.wrap(", ".join(stage.reads), 19)
        for i, line in enumerate(lines):
            above = y - 16 - 12 * (len(lines) - 1 - i)
            parts.append(text(centre, above, line, 10.5, PALE, anchor="middle", style="italic"))
        parts.append(f'<path d="M{centre:g} {y - 11:g}v8" stroke="{PALE}"/>')
    parts += [
        box(x, y, wide, high, PAPER, color, 1.4),
        f'<path d="M{x:g} {y + 9:g}a9 9 0 0 1 9 -9h{wide - 18:g}a9 9 0 0 1 9 9v19h-{wide:g}z" '
        f'fill="{color}"/>',
        text(centre, y + 19, stage.name, 13, PAPER, anchor="middle", weight=600, kind="stage"),
    ]
    for i, line in enumerate(fitted(stage.says, 21, 4 if stage.paper else 5)):
        parts.append(text(centre, y + 46 + 14 * i, line, 10.5, anchor="middle"))
    if stage.paper:
        where = stage.paper.partition(",")[0] if len(stage.paper) > 22 else stage.paper
        parts.append(text(centre, y + high - 16, where, 9.5, PALE, anchor="middle"))
    parts += [
        box(x + 12, y + high - 9, wide - 24, 20, "#f7f8fa", color, 1, 10),
        text(centre, y + high + 5, stage.artifact, 10.5, color, anchor="middle", family=MONO,
             kind="artifact"),
    ]  # fmt: skip
    return parts


def drawn_rooms(bands: list[list[RoomBox]], top: float) -> tuple[list[str], float]:
    """A band a kind of room, boxes in reading order; the y where they end."""
    most = max(room.lines for band in bands for room in band)
    left, high, gap, columns = MARGIN + GUTTER, 66, 10, 6
    wide = (WIDTH - MARGIN - 14 - left - (columns - 1) * gap) / columns
    parts, y = [], top
    for (title, _, may, fill, edge), rooms in zip(BANDS, bands, strict=True):
        rows = -(-len(rooms) // columns)
        tall = rows * high + (rows - 1) * gap + 24
        parts += [
            box(MARGIN, y, WIDTH - 2 * MARGIN, tall, fill, "none", 0, 12),
            text(MARGIN + 16, y + 30, title, 14, weight=600),
        ]
        for i, line in enumerate(textwrap.wrap(may, 16)):
            parts.append(text(MARGIN + 16, y + 48 + 14 * i, line, 11, PALE))
        for i, room in enumerate(rooms):
            across, down = i % columns, i // columns
            x = left + across * (wide + gap)
            parts += drawn_room(room, x, y + 12 + down * (high + gap), wide, high, edge, most)
        y += tall + 10
    return parts, y - 10


def drawn_room(
    room: RoomBox, x: float, y: float, wide: float, high: float, edge: str, most: int
) -> list[str]:
    """Name, lines, description, and a bar as long as the room is large."""
    parts = [
        box(x, y, wide, high, PAPER, edge, 1, 7),
        text(x + 10, y + 18, room.name, 12.5, weight=600, kind="room"),
        text(x + wide - 10, y + 18, f"{room.lines:,}", 10.5, PALE, anchor="end"),
        f'<rect x="{x + 10:g}" y="{y + 24:g}" width="{(wide - 20) * room.lines / most:.1f}" '
        f'height="3" rx="1.5" fill="{edge}"/>',
    ]
    for i, line in enumerate(fitted(room.says, 28, 2)):
        parts.append(text(x + 10, y + 42 + 13 * i, line, 10, "#4b5563"))
    return parts


def chain_of_code() -> str:
    """The way from a stage to the residual as a numbered list; every file calls the next one.

    Raises:
        ValueError: a file does not call the function that follows.
    """
    lines = []
    for number, (file, function) in enumerate(CHAIN, start=1):
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        if number < len(CHAIN):
            target = CHAIN[number][1].rpartition(".")[2]
            if target not in called_from(tree, function):
                raise ValueError(f"{file}: {function} does not lead to {target}: mend CHAIN")
        says = (ast.get_docstring(functions_of(tree)[function]) or "").partition("\n")[0]
        lines.append(f"{number}. `{file}`, `{function}`: {says.rstrip('.')}")
    return "\n".join(lines) + "\n"


def functions_of(tree: ast.Module) -> dict[str, ast.FunctionDef]:
    """The functions of a file, and the methods of its classes as Class.method."""
    functions = {n.name: n for n in tree.body if isinstance(n, ast.FunctionDef)}
    for holder in (n for n in tree.body if isinstance(n, ast.ClassDef)):
        methods = (n for n in holder.body if isinstance(n, ast.FunctionDef))
        functions |= {f"{holder.name}.{method.name}": method for method in methods}
    return functions


def called_from(tree: ast.Module, function: str) -> set[str]:
    """The names that a function calls, and those that functions of the file call for it."""
    functions = functions_of(tree)
    called, left = set[str](), [function]
    while left:
        node = functions[left.pop()]
        calls = (n.func for n in ast.walk(node) if isinstance(n, ast.Call))
        names = {c.id if isinstance(c, ast.Name) else getattr(c, "attr", "") for c in calls}
        # functions are also handed on, to be called elsewhere
        names |= {n.attr for n in ast.walk(node) if isinstance(n, ast.Attribute)}
        new, called = names - called, called | names
        left += [name for name in functions if name.rpartition(".")[2] in new]
    return called


def page_with_chain(page: str) -> str:
    """A page with its numbered list of files replaced."""
    return re.sub(r"(?:^\d\. `.*\n)+", lambda _: chain_of_code(), page, flags=re.M)


def names_in(drawing: str, kind: str) -> list[str]:
    """What is written in a drawing as stage, artifact or room, in order."""
    return re.findall(rf'<text [^>]*class="{kind}">([^<]*)<', drawing)


if __name__ == "__main__":
    TARGET.write_text(picture(stages_of_code(), rooms_of_code()), encoding="utf-8", newline="\n")
    PAGE.write_text(page_with_chain(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
