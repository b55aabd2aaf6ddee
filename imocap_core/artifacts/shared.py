"""A store that several machines share: whole files by name, below a URL or a folder.

    results/<stage>/<key>.mcap       results of stages, by all that they depend on
    results/detections/<key>.npz     detections of videos, likewise
    inputs/<sha-256>                 files of actions, by their content
    actions/<name>.json              the files and results of an action that was pushed

But for the last, a name stands for one content: whoever writes it writes the same.
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, runtime_checkable


@runtime_checkable
class SharedFiles(Protocol):
    """The files of a shared store. Each method raises WorkFailed when the store cannot be used."""

    url: str

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""

    def fetch(self, name: str, file: Path) -> bool:
        """Write the content of a file over `file`; False when there is none."""

    def publish(self, file: Path, name: str) -> None:
        """Make the content of `file` the one of this name; others see it whole or not at all."""
