"""One variant of an action, and where it lies below a benchmark's folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ActionVariant:
    """A variant of an action; `variant`, its name, is for a benchmark to give."""

    folder: Path
    action: str

    @property
    def variant(self) -> str:
        """What is done to the action."""
        raise NotImplementedError

    @property
    def name(self) -> str:
        """The name of the varied action."""
        return f"{self.action}-{self.variant}"

    @property
    def action_folder(self) -> Path:
        """Its action folder."""
        return self.folder / "actions" / self.name

    @property
    def score_file(self) -> Path:
        """The file of its numbers."""
        return self.folder / "scores" / f"{self.name}.json"
