"""The action.yaml of a page: read and written whole, never over another program's change."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock

import yaml

from imocap_core.errors import WorkFailed
from imocap_core.limits import MAX_YAML_BYTES, must_be_small_enough
from imocap_core.pick.changes import Counts, apply_edits
from imocap_core.pick.edits import Edit
from imocap_core.pipeline.action import FILE_NAME, Action, action_of
from imocap_core.pipeline.edited_yaml import edited_text
from imocap_core.pipeline.yaml_file import load_yaml_text
from imocap_core.whole_files import write_whole

MOST_STEPS = 200  # that can be undone


class ChangedElsewhere(Exception):
    """Another program has changed the file since the page read it."""


@dataclass(frozen=True)
class Version:
    """A text of the file; `revision` names it."""

    text: str

    @property
    def revision(self) -> str:
        """Digest of the text."""
        return hashlib.sha256(self.text.encode("utf-8")).hexdigest()


@dataclass
class ActionFile:
    """folder/action.yaml with the steps that can be undone and made again."""

    folder: Path
    _undo: list[tuple[Version, Version]] = field(default_factory=list)  # before, after
    _redo: list[tuple[Version, Version]] = field(default_factory=list)
    _lock: Lock = field(default_factory=Lock)

    @property
    def file(self) -> Path:
        """Its path."""
        return self.folder / FILE_NAME

    def read(self) -> Version:
        """Its present text. WorkFailed when it cannot be read."""
        try:
            must_be_small_enough(self.file, MAX_YAML_BYTES)
            return Version(self.file.read_bytes().decode("utf-8"))
        except (OSError, ValueError) as error:
            raise WorkFailed(f"cannot read {self.file}: {error}") from None

    def action(self, version: Version) -> Action:
        """What a text declares. WorkFailed names every fault in it."""
        try:
            return action_of(load_yaml_text(version.text), self.folder)
        except (yaml.YAMLError, RecursionError, ValueError) as error:
            reason = " ".join(str(error).split())[:300]
            raise WorkFailed(f"{self.file} is not YAML: {reason}") from None

    def edit(self, revision: str, edits: Sequence[Edit], counts: Counts) -> Version:
        """Make edits together, as one step; the new text.

        ChangedElsewhere when the file is no longer of that revision. WorkFailed or ValueError when
        the edits, or what they would make of the file, are wrong; then nothing is written.
        """
        with self._lock:
            before = self._of_revision(revision)
            after = Version(edited_text(before.text, lambda d: apply_edits(d, edits, counts)))
            if after.text != before.text:
                self.action(after)
                self._write(before, after)
                self._undo = [*self._undo, (before, after)][-MOST_STEPS:]
                self._redo = []
            return after

    def undo(self, revision: str) -> Version:
        """The text before the last step, written again; errors as of `edit`."""
        with self._lock:
            return self._step(self._undo, self._redo, revision, back=True)

    def redo(self, revision: str) -> Version:
        """The text after the step that was undone, written again; errors as of `edit`."""
        with self._lock:
            return self._step(self._redo, self._undo, revision, back=False)

    def can_undo(self, version: Version) -> bool:
        """Whether the text is that of the last step."""
        return bool(self._undo) and self._undo[-1][1].text == version.text

    def can_redo(self, version: Version) -> bool:
        """Whether the text is that before the step that was undone."""
        return bool(self._redo) and self._redo[-1][0].text == version.text

    def _step(
        self,
        steps: list[tuple[Version, Version]],
        opposite: list[tuple[Version, Version]],
        revision: str,
        *,
        back: bool,
    ) -> Version:
        present = self._of_revision(revision)
        if not (self.can_undo(present) if back else self.can_redo(present)):
            raise ValueError(f"there is nothing to {'undo' if back else 'do again'}")
        before, after = steps[-1]
        wanted = before if back else after
        self._write(present, wanted)
        opposite.append(steps.pop())
        return wanted

    def _of_revision(self, revision: str) -> Version:
        present = self.read()
        if present.revision != revision:
            raise ChangedElsewhere(
                "action.yaml was changed by another program meanwhile: this shows its new content, "
                "and your last change was not made"
            )
        return present

    def _write(self, present: Version, wanted: Version) -> None:
        if self.read().text != present.text:
            self._of_revision(present.revision)
        write_whole(self.file, wanted.text)
