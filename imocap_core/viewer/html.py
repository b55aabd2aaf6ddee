"""The viewer: one HTML file that holds its program, its data and its pictures."""

from __future__ import annotations

import html
import json
from importlib import resources
from string import Template
from typing import Any

from imocap_core.viewer.block import Block

SCRIPTS = (
    "math.js",
    "theme.js",
    "data.js",
    "body.js",
    "coarse.js",
    "shaders.js",
    "gl.js",
    "shapes.js",
    "skeleton.js",
    "orbit.js",
    "detail.js",
    "scene.js",
    "pictures.js",
    "cards.js",
    "plots.js",
    "curves.js",
    "actors.js",
    "labels.js",
    "address.js",
    "snapshot.js",
    "tools.js",
    "chooser.js",
    "actions.js",
    "main.js",
)
"""In the order in which they are joined: each uses those before it."""


def page(header: dict[str, Any], block: Block, stamp: str) -> str:
    """The whole page; `stamp` says what it was made from."""
    text = json.dumps(header, allow_nan=False, separators=(",", ":"))
    return Template(_source("page.html")).substitute(
        title=html.escape(f"{header['title']} · imocap"),
        stamp=html.escape(stamp, quote=True),
        style=_source("style.css"),
        header=text.replace("<", "\\u003c"),  # no name may end the element
        blob=block.base64(),
        script=program(),
    )


def program() -> str:
    """The page's JavaScript, all files in one."""
    return "\n".join(f"// --- {name}\n{_source(name)}" for name in SCRIPTS)


def sources() -> str:
    """Everything that the page is made of apart from its data: for its stamp."""
    return _source("page.html") + _source("style.css") + program()


def _source(name: str) -> str:
    return (resources.files("imocap_core.viewer") / "web" / name).read_text(encoding="utf-8")
