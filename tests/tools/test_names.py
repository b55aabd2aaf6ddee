"""The rule on names sees what it is to see, and the project keeps it."""

from pathlib import Path

import pytest

from tools.check_names import BUDGETS, FILLERS, faults, main, measured, overruns, words_of_pages


@pytest.mark.parametrize(
    "source",
    [
        "{} = 1\n",
        "for {} in ():\n    pass\n",
        "def f({}):\n    pass\n",
        "def f(*, {}=1):\n    pass\n",
        "x = lambda {}: 1\n",
        "class A:\n    {}: int\n",
        "with open('x') as {}:\n    pass\n",
        "import numpy as {}\n",
        "y = [{} for {} in ()]\n",
        "if ({} := 1):\n    pass\n",
    ],
)
def test_a_filler_is_seen_wherever_it_is_bound(source: str) -> None:
    for filler in sorted(FILLERS):
        assert len(faults({"a.py": source.replace("{}", filler)})) == 1
        assert faults({"a.py": source.replace("{}", f"{filler}_px")}) == []


def test_reading_a_name_is_no_fault() -> None:
    assert faults({"a.py": "x = pandas.at[found.seen]\n"}) == []


def test_one_class_name_has_one_meaning() -> None:
    twice = {"a.py": "class Take:\n    pass\n", "b.py": "class Take:\n    pass\n"}
    assert faults(twice) == ["a.py:1, b.py:1: 2 classes are called Take: one name, one meaning"]
    private = {path: source.replace("Take", "_Take") for path, source in twice.items()}
    assert faults(private) == []


def test_every_page_counts_once_but_not_the_changelog(tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    for page in ("README.md", "CHANGELOG.md", "docs/sync.md", "docs/picture.txt"):
        (tmp_path / page).write_text("# One page\n\n| a |\n")
    assert words_of_pages(tmp_path) == 2 * 6


def test_the_core_is_measured_by_what_one_has_to_read() -> None:
    wide = "def f(self, a, b=1, *, c, d=2):\n    def inner():\n        return a\n    return inner\n"
    sources = {
        "imocap_core/a.py": f"LIMIT, _HIDDEN = 1, 2\n\n\n{wide}",
        "imocap_core/b/c.py": "class Take:\n    size = 0\n\n    def of(self, a):\n        pass\n",
    }
    assert measured(sources) == {
        "files of the core": 2,
        "lines of the core": 12,
        "packages of the core": 2,
        "public names of the core": 3,
        "lines of the core's longest function": 4,
        "arguments of a function of the core": 4,
        "functions of the core with more than 8 arguments": 0,
    }


def test_only_what_is_beyond_its_budget_is_a_fault() -> None:
    most = BUDGETS["words of the documentation"]
    assert overruns({}, words_of_the_documentation=most) == []
    (fault,) = overruns({}, words_of_the_documentation=most + 1)
    assert fault.startswith(f"words of the documentation: {most + 1:,}, at most {most:,}")
    nine = ", ".join(f"a{k}" for k in range(9))
    many = {f"{k}.py": f"def f({nine}):\n    pass\n" for k in range(20)}
    (fault,) = overruns(many)
    assert fault.startswith("functions of the core with more than 8 arguments: 20")


@pytest.mark.long  # as `make lint` says
def test_the_project_keeps_the_rule() -> None:
    assert main() == 0
