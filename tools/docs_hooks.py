"""What `mkdocs.yml` needs beyond its plugins: the README as a page, links that leave docs/.

The pages are written to be read in the repository, where a link may lead to any of its files. In
the site the README's lead to the pages, and a link to a file that is no page becomes its text.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
README = "readme.md"
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


def on_files(files: Any, config: Any) -> Any:
    """Add the README as a page."""
    from mkdocs.structure.files import File

    text = (ROOT / "README.md").read_text(encoding="utf-8")
    files.append(File.generated(config, README, content=readme_page(text)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """A page's text with links that hold in the site."""
    return within_site(markdown, page.file.src_uri.count("/"))


def readme_page(text: str) -> str:
    """The README as if it lay in docs/."""

    def moved(found: re.Match[str]) -> str:
        picture, said, target = found.groups()
        if "://" in target or target.startswith("#"):
            return found[0]
        inside = target.removeprefix("docs/")
        return f"{picture}[{said}]({inside if inside != target else '../' + target})"

    return LINK.sub(moved, text)


def within_site(text: str, depth: int) -> str:
    """Links out of docs/ as plain text, those to the README to its page; `depth` folders below."""
    up = "../" * depth

    def kept(found: re.Match[str]) -> str:
        picture, said, target = found.groups()
        if target.rstrip("/") == "decisions":
            return f"[{said}](decisions/index.md)"
        if not target.startswith(up + "../"):
            return found[0]
        if target == f"{up}../README.md":
            return f"[{said}]({up}{README})"
        return f"*{said}*" if picture else str(said)

    return LINK.sub(kept, text)
