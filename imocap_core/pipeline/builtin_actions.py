"""Built-in actions: made by the project itself when they are absent or made by older code."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.pipeline.source import closure

if TYPE_CHECKING:
    from imocap_core.pipeline.runner import Display

BUILT_IN = ("yoga", "taichi")
MADE = ".made.json"
SCRIPT = Path(__file__).with_name("make_demo.py")


def ensure(name: str, folder: Path, seed: int, display: Display) -> None:
    """Let `folder` hold the built-in action `name` as today's code makes it from `seed`.

    A folder that was not made by this project is somebody's own action and stays as it is.
    """
    key = _key(name, seed)
    why = _why_make(folder, key)
    if why is None:
        return
    display.started("demo", [why])
    from imocap_core.pipeline.make_demo import make_demo

    make_demo(name, folder, seed, lambda what: display.progress(0.0, what))
    files = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())
    (folder / MADE).write_text(json.dumps({"key": key, "files": files}, indent=1) + "\n")
    display.made_demo(name, folder)


def _key(name: str, seed: int) -> str:
    parts = json.dumps([closure(SCRIPT), name, seed])
    return hashlib.sha256(parts.encode()).hexdigest()


def _why_make(folder: Path, key: str) -> str | None:
    """Why the action must be made (again), or None when it need not."""
    if not folder.exists():
        return "the action does not exist yet"
    try:
        made = json.loads((folder / MADE).read_text())
    except FileNotFoundError:
        return None
    except ValueError:
        return f"{MADE} is damaged"
    if made.get("key") != key:
        return "it was made by older code"
    lost = [name for name in made["files"] if not (folder / name).is_file()]
    return f"{lost[0]} is missing" if lost else None
