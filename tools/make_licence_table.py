"""Write the list of docs/licences.md: the licences of all packages that `make` installs.

    .venv/bin/python tools/make_licence_table.py

A package of another system only (Windows, macOS) is not installed here and keeps its row.
"""

from __future__ import annotations

import re
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / "docs" / "licences.md"
PIN = re.compile(r"(?m)^([A-Za-z0-9._-]+)==([^\s;]+)")
ROW = re.compile(r"(?m)^\* `([^`]+)` (\S+), (.+)$")
HEAD = "## Packages, versions, licences\n\n"


def licence_of(name: str) -> str:
    """As a package's metadata declare it: an SPDX expression, else classifiers, else words."""
    fields = metadata.metadata(name)
    declared = fields.get("License-Expression")
    if declared:
        return str(declared)
    classifiers = [str(c) for c in fields.get_all("Classifier") or []]
    names = [c.split(" :: ")[-1] for c in classifiers if c.startswith("License :: OSI Approved ::")]
    words = (str(fields.get("License") or "").strip().splitlines() or [""])[0]
    return ", ".join(names) or words[:60]


def rows_of(text: str) -> dict[str, tuple[str, str]]:
    """Package -> version and licence, of a page."""
    return {name: (version, licence) for name, version, licence in ROW.findall(text)}


def document(pins: dict[str, str], page: str) -> str:
    """The page with its list made anew; rows of packages that are not installed here stay."""
    before, lines = rows_of(page), []
    for name in sorted(pins, key=str.lower):
        try:
            licence = licence_of(name)
        except metadata.PackageNotFoundError:
            licence = before.get(name, ("", ""))[1]
        lines.append(f"* `{name}` {pins[name]}, {licence or 'not declared'}\n")
    return page[: page.index(HEAD)] + HEAD + "".join(lines)


def pins_of(root: Path) -> dict[str, str]:
    """The pinned packages of constraints.txt and locked.txt."""
    pins = dict(PIN.findall((root / "locked.txt").read_text()))
    torch = dict(PIN.findall((root / "constraints.txt").read_text()))["torch"]
    return pins | {"torch": torch}


def main() -> None:
    """Write the page."""
    FILE.write_text(document(pins_of(ROOT), FILE.read_text()))


if __name__ == "__main__":
    main()
