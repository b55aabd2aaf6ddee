"""Jobs of rendered actions: which there are, and their folders made where they are stale."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from benchmarks.actions.action_folder import is_made
from benchmarks.actions.captured import DEFAULT_VIDEOS, data_folder
from benchmarks.rendered.action import key_of, make_rendered
from imocap_core.errors import WrongUse
from imocap_core.pipeline.runner import Display, Job
from imocap_core.workspace import Workspace


@dataclass(frozen=True)
class RenderedChoice:
    """What to run: videos per action, whether pictures have a quarter of the pixels, the actions
    (all when empty)."""

    videos: int = DEFAULT_VIDEOS
    small: bool = False
    only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= self.videos <= DEFAULT_VIDEOS:
            raise WrongUse(f"--videos: expected 1 to {DEFAULT_VIDEOS}, got {self.videos}")

    @property
    def label(self) -> str:
        """The name of its folder and table."""
        return f"rendered-{self.videos}v" + "-small" * self.small

    @property
    def command(self) -> str:
        """The command that measures all actions of this choice."""
        return f"imocap benchmark rendered --videos {self.videos}" + " --small" * self.small

    def folder(self, root: Path) -> Path:
        """The folder of its actions, artifacts, scores and tables."""
        return root / "artifacts" / "benchmark" / self.label


def rendered_names(root: Path) -> list[str]:
    """Every action that can be rendered: those of trials."""
    return [file.stem for file in sorted(data_folder(root, "trials").glob("*.npz"))]


def ready_rendered(root: Path, choice: RenderedChoice, name: str, display: Display) -> Job:
    """A job of an action; it is rendered first unless the same code and data made it."""
    if not _is_made(root, choice, name):
        display.started("render", ["its performances are not rendered"])
        file, folder = _captured(root, name), _folder(root, choice, name)
        make_rendered(folder, name, file, choice.videos, choice.small, display.progress)
    return _workspace(root, choice).ready_job(str(_folder(root, choice, name)), [], display)


def existing_rendered(root: Path, choice: RenderedChoice, name: str) -> Job | None:
    """A job of an action without making anything; None when its folder is missing or stale."""
    if not _is_made(root, choice, name):
        return None
    return _workspace(root, choice).job(str(_folder(root, choice, name)), [])


def _workspace(root: Path, choice: RenderedChoice) -> Workspace:
    return Workspace(choice.folder(root))


def _folder(root: Path, choice: RenderedChoice, name: str) -> Path:
    return choice.folder(root) / "actions" / name


def _captured(root: Path, name: str) -> Path:
    return data_folder(root, "trials") / f"{name}.npz"


def _is_made(root: Path, choice: RenderedChoice, name: str) -> bool:
    key = key_of(name, _captured(root, name), choice.videos, choice.small)
    return is_made(_folder(root, choice, name), key)
