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
def open_session(name: str, videos: Sequence[Path], root: Path) -> Session:
    """The session of an action, by name or folder; with videos it is made first, as by `init`.

    WrongUse when there is none, WorkFailed when its action.yaml is wrong.
    """
    if videos:
        action_of_videos(root, name, videos)
    return Session(root, name, find_action(name, root))


@contextmanager
def picking(
    name: str,
    videos: Sequence[Path],
    root: Path,
    port: int = 0,
    fault: Callable[[str], None] = lambda sentence: None,
) -> Iterator[Served]:
    """Serve the page of an action while the body runs (arguments: `open_session`, `serving`)."""
    with serving(open_session(name, videos, root), port, fault) as served:
        yield served
