"""The pages of an action, which lead to each other: the report's links, and the index."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from imocap_core import viewer
from imocap_core.artifacts.store import Store
from imocap_core.diagnostics.findings import FILE, Verdict, read_verdict
from imocap_core.files import is_as_made, record_made, write_whole

PAGE = "report.html"
_INDEX, _VIEWER = "index.html", "3D viewer"
LEVELS = {"good": "Good", "check": "Check", "doubt": "Doubtful"}
_COMPARED = "where performances differ, in degrees"
_LINKS = re.compile(r'<nav class="pages">.*?</nav>', re.DOTALL)

# Not in this package: a change of style would make the stage that draws its figures stale.
WEB = Path(str(viewer.__file__)).with_name("web")


@dataclass(frozen=True)
class ActionPage:
    """One thing that can be opened. file: relative to the action's folder, or None when it has not
    been made; command: what makes it."""

    name: str
    what: str
    file: str | None
    command: str


def _pages_of(folder: Path, action: str) -> list[ActionPage]:
    """What there is to open in an action's folder of the store, and what could be made."""

    def page(name: str, what: str, file: str, command: str) -> ActionPage:
        return ActionPage(name, what, file if (folder / file).exists() else None, command)

    card = page("Card", "the largest differences, for a phone or for paper", "report/card.html", "")
    compared = sorted((folder / "report" / "compare").rglob(PAGE))
    comparisons = [
        ActionPage(
            f"Comparison with {inner}" if inner not in ("compare", "report") else "Comparison",
            _COMPARED,
            file,
            "",
        )
        for file, inner in ((p.relative_to(folder).as_posix(), p.parent.name) for p in compared)
    ]
    return [
        page(
            _VIEWER,
            "the bodies in motion beside the videos, from any side",
            "report/viewer.html",
            f"imocap view {action}",
        ),
        page(
            "Report",
            "the verdict, the same moments, the key angles; technical details below",
            f"report/{PAGE}",
            f"imocap run {action}",
        ),
        *([card] if card.file else []),
        *(comparisons or [ActionPage("Comparison", _COMPARED, None, f"imocap compare {action}")]),
        page("Films", "every video with the body over it", "videos", f"imocap video {action}"),
        ActionPage(
            "Exports", "the motion for other programs", None, f"imocap export {action} --out FOLDER"
        ),
    ]


def links(folder: Path, action: str) -> str:
    """The report's links to the other pages of an action, as HTML."""
    shown = "".join(
        f'<a href="../{html.escape(p.file)}">{html.escape(p.name)}</a>'
        if p.file
        else f"<span>{p.name}: <code>{html.escape(p.command)}</code></span>"
        for p in _pages_of(folder, action)
        if (p.file and p.file != f"report/{PAGE}") or p.name == _VIEWER
    )
    below = '<a href="#technical">Technical details</a>'
    return f'<nav class="pages">{shown}<a href="../{_INDEX}">All pages</a>{below}</nav>'


def refresh_pages(store: Store, action: str) -> Path:
    """Let the report name what there is now, and write the index; the index's path.

    A report that somebody has changed is left as it is.
    """
    folder, report = store.folder / action, store.report(action)
    if is_as_made(report, PAGE):
        text = (report / PAGE).read_text(encoding="utf-8")
        now = _LINKS.sub(lambda _: links(folder, action), text, count=1)
        if now != text:
            write_whole(report / PAGE, now)
            record_made(report, [PAGE])
    index = folder / _INDEX
    verdict = None
    with suppress(OSError, ValueError):
        verdict = read_verdict((report / FILE).read_text(encoding="utf-8"))
    text = "".join(_index(folder, action, verdict))
    if not index.is_file() or index.read_text(encoding="utf-8") != text:
        write_whole(index, text)
    return index


def _index(folder: Path, action: str, verdict: Verdict | None) -> Iterator[str]:
    name = html.escape(action)
    yield html_head(f"{name} · imocap", "index.css")
    yield f"<h1>{name}{badge(verdict)}</h1>\n{sentences(verdict)}<dl>\n"
    for page in _pages_of(folder, action):
        title = html.escape(page.name)
        if page.file:
            yield f'<dt><a href="{html.escape(page.file)}">{title}</a></dt><dd>{page.what}</dd>\n'
        else:
            command = f"<code>{html.escape(page.command)}</code>"
            yield f"<dt>{title}</dt><dd>{page.what}; make it with {command}</dd>\n"
    yield "</dl></body></html>\n"


def html_head(title: str, style: str, meta: str = "") -> str:
    """The beginning of a page, up to its body. title, meta: HTML. style: the page's own in web/,
    after the one that all pages share."""
    css = "".join("\n" + (WEB / n).read_text(encoding="utf-8") for n in ("pages.css", style))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">{meta}'
        f"<title>{title}</title><style>{css}</style></head><body>\n"
    )


def badge(verdict: Verdict | None) -> str:
    """The verdict's level as a word in its colour; nothing without a verdict."""
    if verdict is None:
        return ""
    return f'<span class="level {verdict.level}">{LEVELS[verdict.level]}</span>'


def prose(text: str) -> str:
    """Markup of a sentence; what stands between backticks is a command."""
    return re.sub("`(.+?)`", r"<code>\1</code>", html.escape(text))


def sentences(verdict: Verdict | None) -> str:
    """The verdict's sentences in a block of its colour."""
    if verdict is None:
        return ""
    summary = "".join(f"<p>{prose(sentence)}</p>" for sentence in verdict.summary)
    return f'<div class="verdict {verdict.level}">{summary}</div>\n'
