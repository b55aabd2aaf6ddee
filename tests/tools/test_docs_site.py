"""The pages of the documentation: linked to each other rightly, all of them in the site; what
docs/paper.md and the picture of the architecture show exists."""

import importlib
import os
import re
import shutil
import subprocess
import tomllib
from itertools import chain
from pathlib import Path
from typing import Any

import grimp
import pytest
import yaml
from typer.main import get_command

import imocap
from imocap_core.cli.app import app
from imocap_core.params import Params
from imocap_core.pipeline.graph import read_pipeline, settings
from imocap_core.version import __version__
from tools import docs_hooks as hooks
from tools import make_architecture_picture as tool
from tools.make_architecture_picture import TARGET, RoomBox, StageBox, names_in

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
MKDOCS = shutil.which("mkdocs", path=f"{ROOT / '.venv-docs' / 'bin'}{os.pathsep}{os.defpath}")

FOLDERS = "imocap|imocap_core|stages|benchmarks|tests|tools|docs|examples"
GUIDE = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *DOCS.rglob("*.md")])


def pages(nav: Any) -> list[str]:
    if isinstance(nav, str):
        return [nav]
    parts = nav.values() if isinstance(nav, dict) else nav
    return [page for part in parts for page in pages(part)]


def test_every_page_has_its_place_in_the_site() -> None:
    listed = pages(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"])
    there = {p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md")}
    from_root = set(hooks.FROM_ROOT.values())
    assert set(listed) == there | from_root, "name every page in mkdocs.yml, under nav"
    assert len(listed) == len(set(listed))


def test_every_link_leads_to_a_file() -> None:
    broken = []
    at_the_top = [*ROOT.glob("*.md"), *ROOT.glob("actions/*.md"), *ROOT.glob("artifacts/*.md")]
    for file in [*at_the_top, *DOCS.rglob("*.md")]:
        text = re.sub(r"```.*?```|`[^`]*`", "", file.read_text(encoding="utf-8"), flags=re.S)
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            path = target.partition("#")[0]
            if "://" not in target and path and not (file.parent / path).exists():
                broken.append(f"{file.relative_to(ROOT)}: {target}")
    assert broken == []


def is_module(path: str) -> bool:
    return (ROOT / path / "__init__.py").is_file() or (ROOT / f"{path}.py").is_file()


@pytest.mark.parametrize("file", GUIDE, ids=lambda file: str(file.relative_to(ROOT)))
def test_every_file_and_module_that_a_page_names_exists(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    named = set(re.findall(rf"`((?:{FOLDERS})/[\w/.-]+)`", text))
    modules = {name.replace(".", "/") for name in re.findall(r"`(imocap_core(?:\.\w+)+)`", text)}
    missing = {name for name in named if not (ROOT / name).exists()}
    missing |= {m for m in modules if not is_module(m) and not is_module(m.rpartition("/")[0])}
    assert missing == set()


def test_every_command_that_a_page_names_exists() -> None:
    commands = set(get_command(app).commands)  # type: ignore[attr-defined]
    missing = {
        f"{file.relative_to(ROOT)}: imocap {word}"
        for file in GUIDE
        for word in re.findall(r"(?:^|`|bin/)imocap ([a-z][\w-]*)", file.read_text(), flags=re.M)
        if word not in commands
    }
    assert missing == set()


def test_every_public_name_is_on_the_page_of_the_library() -> None:
    page = (DOCS / "library.md").read_text(encoding="utf-8")
    named = set(re.findall(r"(?:^::: |`)imocap\.(\w+)", page, flags=re.M))
    assert named == set(imocap.__all__)


def test_links_out_of_the_pages_become_text() -> None:
    text = "[a](../pipeline.yaml), [R](../README.md#y), [b](sync.md#x), [`c`](../stages/a.py)"
    assert hooks.within_site(text, 0) == "a, [R](readme.md#y), [b](sync.md#x), `c`"
    assert hooks.within_site("[a](../sync.md) [b](../../LICENSE)", 1) == "[a](../sync.md) b"


def test_links_of_the_pages_at_the_top_work_among_the_others() -> None:
    text = "![p](docs/images/a.png) [s](docs/sync.md) [l](LICENSE) [w](https://e.org) [x](#limits)"
    moved = hooks.moved_into_docs(text)
    assert moved == (
        "![p](images/a.png) [s](sync.md) [l](../LICENSE) [w](https://e.org) [x](#limits)"
    )
    assert hooks.within_site(moved, 0).split()[2] == "l"
    moved = hooks.moved_into_docs("[c](CONTRIBUTING.md) [d](docs/decisions.md)")
    assert hooks.within_site(moved, 0) == "[c](contributing.md) [d](decisions.md)"


def test_pictures_lead_to_the_viewers_that_were_made(tmp_path):
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert hooks.with_viewers(text, tmp_path) == text  # pictures, as in the repository
    (tmp_path / "yoga.html").write_bytes(b"a" * 1_250_000)
    linked = hooks.with_viewers(text, tmp_path)
    assert "(images/viewer.png)](gallery/yoga.html)" in linked
    assert "(gallery/yoga.html) (1.2 MB)" in linked
    assert linked.count("gallery/") == 2
    assert linked.count("images/") == text.count("images/")


def test_the_citation_file_names_the_project_and_the_paper() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {"cff-version", "message", "title", "authors"} <= set(citation)  # required
    assert citation["cff-version"] == "1.2.0"
    assert citation["version"] == __version__
    assert citation["license"] == project["license"]
    assert [a["name"] for a in citation["authors"]] == [a["name"] for a in project["authors"]]
    (paper,) = citation["references"]
    assert {"type", "title", "authors"} <= set(paper)
    assert len(paper["authors"]) == 6


@pytest.mark.skipif(MKDOCS is None, reason="no mkdocs; make docs installs it in .venv-docs")
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    done = subprocess.run(
        [MKDOCS, "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "site" / "tutorial.html").is_file()


PAGE = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
STAGES = yaml.safe_load((ROOT / "pipeline.yaml").read_text(encoding="utf-8"))["stages"]
JOINT_SOLVE = "imocap_core.motion.multiview.smpl_ba.recover_motion"
# Of Python or of files: dotted names that the page may use besides functions and parameters.
DOTTED = re.compile(r"`([a-z]\w*(?:\.\w+)+)`")
FILES = re.compile(r"`((?:tools|tests|stages|benchmarks|imocap_core)/[\w/.]+)`")


def rows() -> list[list[str]]:
    """The cells of the table's rows."""
    lines = [line for line in PAGE.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines[1:]]


def named(path: str) -> Any:
    """What a dotted path in imocap_core names; LookupError when there is no such thing."""
    words = path.removeprefix("imocap_core.").split(".")
    for cut in range(len(words), 0, -1):
        module = ".".join(["imocap_core", *words[:cut]])
        try:
            thing: Any = importlib.import_module(module)
        except ModuleNotFoundError:
            continue
        for word in words[cut:]:
            if not hasattr(thing, word):
                raise LookupError(f"{path}: {module} has no {word}")
            thing = getattr(thing, word)
        return thing
    raise LookupError(f"{path}: no such module")


def check_parameter(text: str) -> None:
    """`group.name`, `group.*`, or `group.name: value`; LookupError when it is none."""
    name, _, value = text.partition(": ")
    group, _, field = name.partition(".")
    fields = getattr(Params(), group, None)
    if fields is None or (field != "*" and not hasattr(fields, field)):
        raise LookupError(f"{name}: no such parameter")
    if value:
        pipeline = read_pipeline(ROOT / "pipeline.yaml")
        settings(pipeline, {group: {field: yaml.safe_load(value)}}, Path("docs/paper.md"), [])


def check_row(functions: str, stages: str, tests: str, parameters: str) -> None:
    """LookupError for the first thing in a row of the table that does not exist."""
    module = ""
    for path in re.findall(r"`([^`]+)`", functions):
        full = path if "." in path else f"{module}.{path}"
        named(full)
        module = full.rpartition(".")[0]
    for stage in stages.split(", "):
        if stage not in STAGES:
            raise LookupError(f"{stage}: no such stage")
    folder = ROOT
    for test in tests.split(", "):
        file = ROOT / test if "/" in test else folder / test
        if not file.exists():
            raise LookupError(f"{test}: no such test")
        folder = file.parent
    for text in re.findall(r"`([^`]+)`", parameters):
        check_parameter(text)


@pytest.mark.parametrize("row", rows(), ids=lambda row: row[0])
def test_everything_in_a_row_exists(row: list[str]) -> None:
    assert len(row) == 5, f"docs/paper.md: expected 5 cells, got {row}"
    try:
        check_row(*row[1:])
    except LookupError as error:
        pytest.fail(f"docs/paper.md, row {row[0]!r}: {error}")


def test_the_table_names_the_entry_of_the_joint_solve() -> None:
    assert any(f"`{JOINT_SOLVE}`" in row[1] for row in rows())


@pytest.mark.parametrize("name", sorted(set(DOTTED.findall(PAGE))))
def test_every_dotted_name_on_the_page_exists(name: str) -> None:
    group = name.partition(".")[0]
    if hasattr(Params(), group):
        try:
            check_parameter(name)
        except LookupError:
            named(name)
    else:
        named(name)


@pytest.mark.parametrize("file", sorted(set(FILES.findall(PAGE))))
def test_every_file_on_the_page_exists(file: str) -> None:
    assert (ROOT / file).exists()


def test_what_does_not_exist_is_noticed() -> None:
    with pytest.raises(LookupError, match=r"affinity has no gone"):
        check_row("`sync.affinity.gone`", "sync", "tests/sync/test_affinity.py", "–")
    with pytest.raises(LookupError, match="no such stage"):
        check_row("`sync.warp.dtw.dtw`", "synchronise", "tests/sync/test_dtw.py", "–")
    with pytest.raises(LookupError, match="no such test"):
        check_row("`sync.warp.dtw.dtw`", "sync", "tests/sync/test_dtw.py, test_gone.py", "–")
    with pytest.raises(LookupError, match="no such parameter"):
        check_row("`sync.warp.dtw.dtw`", "sync", "tests/sync/test_dtw.py", "`sync.gone`")


ADVICE = "run: python -m tools.make_architecture_picture"


@pytest.fixture(scope="module")
def bands() -> list[list[RoomBox]]:
    return tool.rooms_of_code()


@pytest.fixture(scope="module")
def stages() -> list[StageBox]:
    return tool.stages_of_code()


def lines_in(drawing: str) -> int:
    (total,) = re.findall(r"lines of Python, ([\d,]+) in all", drawing)
    return int(total.replace(",", ""))


def test_the_committed_picture_shows_the_code(stages, bands):
    committed = TARGET.read_text(encoding="utf-8")
    assert names_in(committed, "stage") == [stage.name for stage in stages], ADVICE
    assert names_in(committed, "artifact") == [stage.artifact for stage in stages], ADVICE
    assert names_in(committed, "room") == [room.name for room in chain(*bands)], ADVICE
    total = sum(room.lines for room in chain(*bands))
    assert lines_in(committed) == pytest.approx(total, rel=0.1), ADVICE


def test_the_same_code_gives_the_same_bytes(stages, bands):
    drawing = tool.picture(stages, bands)
    assert drawing == tool.picture(tool.stages_of_code(), tool.rooms_of_code())


def test_the_page_says_the_way_from_a_stage_to_the_residual_as_the_code_calls() -> None:
    page = tool.PAGE.read_text(encoding="utf-8")
    assert tool.chain_of_code() in page, ADVICE
    assert tool.page_with_chain(page) == page
    assert len(tool.CHAIN) == 5


def test_a_way_that_the_code_does_not_call_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tool, "CHAIN", (*tool.CHAIN[:2], tool.CHAIN[4], tool.CHAIN[3]))
    with pytest.raises(ValueError, match="does not lead to add_to"):
        tool.chain_of_code()


def test_every_import_leads_to_a_later_room(bands: list[list[RoomBox]]) -> None:
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    order = {room.name: place for place, room in enumerate(chain(*bands))}
    graph = grimp.build_graph(*contract["root_packages"], cache_dir=None)
    rooms = {m: m.removeprefix("imocap_core.").split(".")[0] for m in graph.modules}
    wrong = {
        f"{rooms[module]} imports {rooms[other]}"
        for module in graph.modules
        for other in graph.find_modules_directly_imported_by(module)
        if order.get(rooms[module], 0) > order.get(rooms[other], len(order))
    }
    assert wrong == set()
