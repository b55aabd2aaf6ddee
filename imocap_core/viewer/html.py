"""The viewer: one HTML file that holds its program, its data and its pictures."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from importlib import resources
from string import Template
from typing import Any

from imocap_core.viewer.block import Block

PACKAGE = "imocap_core.viewer"
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
    "transport.js",
    "chooser.js",
    "actions.js",
    "main.js",
)
"""In the order in which they are joined: each uses those before it."""


def page(header: dict[str, Any], block: Block, stamp: str) -> str:
    """The whole page; `stamp` says what it was made from."""
    return filled(header, block, stamp, source("page.html"), source("style.css"), program())


def filled(
    header: dict[str, Any], block: Block, stamp: str, document: str, style: str, script: str
) -> str:
    """A document with its data, style and script in their places; its title is the header's."""
    text = json.dumps(header, allow_nan=False, separators=(",", ":"))
    return Template(document).substitute(
        title=html.escape(f"{header['title']} · imocap"),
        stamp=html.escape(stamp, quote=True),
        style=style,
        header=text.replace("<", "\\u003c"),  # no name may end the element
        blob=block.base64(),
        script=script,
    )


def program() -> str:
    """The page's JavaScript, all files in one."""
    return joined(SCRIPTS)


def joined(names: Sequence[str], package: str = PACKAGE) -> str:
    """Files of JavaScript, one after another."""
    return "\n".join(f"// --- {name}\n{source(name, package)}" for name in names)


def sources() -> str:
    """Everything that the page is made of apart from its data: for its stamp."""
    return source("page.html") + source("style.css") + program()


def source(name: str, package: str = PACKAGE) -> str:
    """A file of a page's program, from the folder web of a package."""
    return (resources.files(package) / "web" / name).read_text(encoding="utf-8")
