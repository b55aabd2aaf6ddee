"""pick: the page on which an action's clips, performers, spans and anchors are chosen."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from imocap_core.library.door import plain_errors
from imocap_core.library.new_action import action_of_videos
from imocap_core.pick.server import Served, serving
from imocap_core.pick.session import Session
from imocap_core.pipeline.action import find_action


@plain_errors
def open_session(name: str, videos: Sequence[Path], root: Path) -> tuple[Session, list[str]]:
    """The session of an action, by name or folder, and remarks on its files.

    With videos it is made first, as by `init`. WrongUse when there is none, WorkFailed when its
    action.yaml is wrong.
    """
    remarks = action_of_videos(root, name, videos)[1] if videos else []
    return Session(root, name, find_action(name, root)), remarks


@contextmanager
def picking(
    name: str,
    videos: Sequence[Path],
    root: Path,
    port: int = 0,
    fault: Callable[[str], None] = lambda sentence: None,
) -> Iterator[Served]:
    """Serve the page of an action while the body runs (arguments: `open_session`, `serving`)."""
    session, remarks = open_session(name, videos, root)
    with serving(session, port, fault, remarks) as served:
        yield served
