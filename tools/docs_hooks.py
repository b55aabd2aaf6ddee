"""What `mkdocs.yml` needs beyond its plugins: pages from the repository's root, links out of docs/.

The pages are written to be read in the repository, where a link may lead to any of its files. In
the site, README.md and the others of `FROM_ROOT` are pages too, and a link to a file that is no
page becomes its text. Viewers that lie in build/gallery (`make gallery` writes them, of actions
that have been run) become pages that their pictures lead to; they are too large to be committed.
"""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FROM_ROOT = {
    "README.md": "readme.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
}
GALLERY = ROOT / "build" / "gallery"
VIEWER = re.compile(r"<!-- viewer (\w+) -->\n(.*?)\n<!-- /viewer -->", re.S)
LINKED = """[{picture}](gallery/{name}.html)

[Turn it and play it: the viewer of {name}](gallery/{name}.html) ({size:.1f} MB)"""
BARRED = re.compile(r"`([^`]*\\\|[^`]*)`")  # code with bars, in a table
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


def on_files(files: Any, config: Any) -> Any:
    """Add the pages from the repository's root, and the viewers."""
    from mkdocs.structure.files import File

    for viewer in sorted(GALLERY.glob("*.html")):
        place = f"gallery/{viewer.name}"
        files.append(File.generated(config, place, abs_src_path=str(viewer)))

    for name, page in FROM_ROOT.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        files.append(File.generated(config, page, content=moved_into_docs(text)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """A page's text with links that work in the site."""
    text = BARRED.sub(lambda m: f"<code>{bars_of_code(m[1])}</code>", markdown)
    return within_site(with_viewers(text, GALLERY), page.file.src_uri.count("/"))


def bars_of_code(code: str) -> str:
    """Markup of code whose bars a table would take for its own, escaped as in the repository."""
    return html.escape(code, quote=False).replace("\\|", "&#124;")


def with_viewers(text: str, folder: Path) -> str:
    """A page whose pictures lead to those of their viewers that are in the folder."""

    def linked(viewer: re.Match[str]) -> str:
        name, picture = viewer.groups()
        file = folder / f"{name}.html"
        size = file.stat().st_size / 1e6 if file.is_file() else 0.0
        return LINKED.format(name=name, picture=picture, size=size) if size else viewer[0]

    return VIEWER.sub(linked, text)


def moved_into_docs(text: str) -> str:
    """A page of the repository's root as if it lay in docs/."""

    def moved(link: re.Match[str]) -> str:
        picture, words, target = link.groups()
        if "://" in target or target.startswith("#"):
            return link[0]
        if target.startswith("docs/"):
            return f"{picture}[{words}]({target.removeprefix('docs/')})"
        return f"{picture}[{words}](../{target})"

    return LINK.sub(moved, text)


def within_site(text: str, depth: int) -> str:
    """Links out of docs/ as plain text, unless to a page; the text lies `depth` folders below."""
    up = "../" * depth

    def adapted(link: re.Match[str]) -> str:
        picture, words, target = link.groups()
        if not target.startswith(up + "../"):
            return link[0]
        name, hash_, anchor = target.removeprefix(up + "../").partition("#")
        if name in FROM_ROOT:
            return f"[{words}]({up}{FROM_ROOT[name]}{hash_}{anchor})"
        return f"*{words}*" if picture else str(words)

    return LINK.sub(adapted, text)
