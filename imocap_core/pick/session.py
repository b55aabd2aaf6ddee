"""One use of `imocap pick`: an action.yaml, its videos, and what the videos contradict."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from shlex import join
from threading import Lock, Thread
from typing import Any

import yaml

from imocap_core.errors import ImocapError, WorkFailed
from imocap_core.files import write_whole
from imocap_core.library.people import detect
from imocap_core.library.status import status
from imocap_core.limits import LEAST_FRAMES, MAX_YAML_BYTES, must_be_small_enough
from imocap_core.pick.edits import Counts, Edit, apply_edits, person_fields
from imocap_core.pick.media import END_S, BackgroundThread, Media, Tracks
from imocap_core.pipeline.action import FILE_NAME, Action, Declaration, action_of, repeated_files
from imocap_core.pipeline.yaml_file import edited_text, load_yaml_text
from imocap_core.workspace import Workspace


def warnings_of(action: Action, counts: Mapping[str, int]) -> list[str]:
    """A sentence on all that a run would refuse or leave out; counts: frames of the files."""
    spans = {v.id: _span(v, counts.get(v.id)) for v in action.videos}
    sentences = []
    for video in action.videos:
        sentences += _of_video(video, counts.get(video.id))
    for number, anchor in enumerate(action.anchors, start=1):
        for name, frame in anchor.frames.items():
            first, stop = spans[name]
            if not first <= frame < stop:
                sentences.append(
                    f"Anchor {number} is on frame {frame} of {name}, which is not used "
                    f"({_words(first, stop)} are): remove the anchor or use more of {name}"
                )
    return sentences


def _span(video: Declaration, count: int | None) -> tuple[int, float]:
    return video.frames or (0, float("inf") if count is None else count)


def _of_video(video: Declaration, count: int | None) -> list[str]:
    first, stop = _span(video, count)
    sentences = []
    if count is not None and stop > count:
        sentences.append(f"{video.id} uses {_words(first, stop)}, but it has only {count} frames")
    if stop - first < LEAST_FRAMES:
        used = f"{video.id} uses {stop - first:.0f} frames"
        sentences.append(f"{used}: at least {LEAST_FRAMES} are needed to show a motion")
    person = video.person
    if person is not None and person.frame is not None and not first <= person.frame < stop:
        sentences.append(
            f"The performer of {video.id} is named in frame {person.frame}, which is not used: "
            "choose them again"
        )
    if video.keypoints is None:
        sentences.append(f"{video.id} has no keypoints: find people, or name a file in action.yaml")
    return sentences


def _words(first: int, stop: float) -> str:
    return f"frames {first} to {stop - 1:.0f}" if stop != float("inf") else f"frames from {first}"


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


@dataclass(frozen=True)
class RunPlan:
    """What a run of some revision would do, or why it would not begin."""

    revision: str
    stages: list[dict[str, Any]]
    notes: list[str]
    fault: str | None = None


@dataclass
class Detection:
    """The detection of people: idle, running, done or failed; how far, and what it is doing."""

    state: str = "idle"
    share: float = 0.0
    text: str = ""


class Session:
    """What the page shows and changes. `name`: the action as it was given, by name or folder."""

    def __init__(self, root: Path, name: str, folder: Path) -> None:
        self.root, self.name = root, name
        self.file = ActionFile(folder)
        self.detection = Detection()
        self._reading = BackgroundThread("strips")
        self._thinking = BackgroundThread("tracks")
        self._stopping = self._thinking.stopping
        self.media = Media(self._reading)
        self.tracks = Tracks(self._thinking)
        self._valid = self.file.action(self.file.read())  # WorkFailed before a page is shown
        self._detecting: Thread | None = None
        self._plan: RunPlan | None = None
        self._stamp: tuple[object, ...] = ()
        self._latest: tuple[str, dict[str, int]] = ("", {})

    def close(self) -> None:
        """End what goes on in the background."""
        self._stopping.set()
        if self._detecting is not None:
            self._detecting.join(END_S)
        self._reading.close()
        self._thinking.close()
        self.media.close()

    def counts(self) -> dict[str, int]:
        """Frames of each video's file, where they are counted."""
        paths = {v.id: path for v in self._valid.videos if (path := self._path(v)) is not None}
        counts = {video: self.media.count(path) for video, path in paths.items()}
        return {video: count for video, count in counts.items() if count is not None}

    def find_people(self) -> None:
        """Detect people in the background. ValueError when that goes on already."""
        if self.detection.state == "running":
            raise ValueError("people are being looked for already")
        self.detection = Detection("running", 0.0, "starting")
        self._detecting = Thread(target=self._detect, name="detection", daemon=True)
        self._detecting.start()

    def document(self) -> dict[str, Any]:
        """All that the page shows, apart from pictures and outlines."""
        fault = None
        version: Version | None = None
        try:
            version = self.file.read()
            self._valid = self.file.action(version)
        except ImocapError as error:
            fault = self.plain(str(error))
        action = self._valid
        videos = [self._entry(video) for video in action.videos]
        counts = self.counts()
        if version is not None and fault is None:
            self._look_again(version, counts)
        file, root, plan = self.file.file.resolve(), self.root.resolve(), self._plan
        if version is None or plan is None or plan.revision != version.revision:
            plan = None
        return {
            "action": action.name,
            "name": self.name,
            "file": str(file.relative_to(root) if file.is_relative_to(root) else file),
            "command": self._command(),
            "revision": None if version is None else version.revision,
            "fault": fault,
            "videos": videos,
            "files": self.media.documents(),
            "anchors": [{"frames": a.frames, "hard": a.hard} for a in action.anchors],
            "forbidden": [s.model_dump(mode="json") for s in action.forbidden],
            "event": action.event,
            "warnings": warnings_of(action, counts) + (plan.notes if plan else []),
            "plan": None if plan is None else {"stages": plan.stages, "fault": plan.fault},
            "detection": vars(self.detection),
            "can_undo": version is not None and self.file.can_undo(version),
            "can_redo": version is not None and self.file.can_redo(version),
        }

    def plain(self, sentence: str) -> str:
        """A sentence that names the file as people call it."""
        return sentence.replace(str(self.file.file), "action.yaml")

    def _path(self, video: Declaration) -> Path | None:
        return None if video.video is None else (self.file.folder / video.video).resolve()

    def _entry(self, video: Declaration) -> dict[str, Any]:
        path = self._path(video)
        fields = {"id", "frames", "mirrored", "performer", "fps", "size"}
        return video.model_dump(mode="json", include=fields) | {
            "person": None if video.person is None else person_fields(video.person),
            "file": None if path is None else self.media.number(path),
            "detect": video.detected,
            "no_keypoints": video.keypoints is None,
            "people": self.tracks.state(video.id),
        }

    def _command(self) -> str:
        here = self.root.resolve() == Path.cwd().resolve()
        place = [] if here else ["--root", str(self.root)]
        return join(["imocap", *place, "run", self.name])

    def _look_again(self, version: Version, counts: dict[str, int]) -> None:
        """Queue what follows from a new text, newly counted frames or new detections."""
        video = self.detection.text.partition(":")[0]  # at which the detector is
        stamp = (version.revision, tuple(sorted(counts)), self.detection.state, video)
        if stamp != self._stamp:
            self._stamp, self._latest = stamp, (version.revision, counts)
            self._thinking.add("tracks", self._follow_people)
            self._thinking.add("plan", self._make_plan)

    def _follow_people(self) -> None:
        _, counts = self._latest
        with suppress(ImocapError, OSError, ValueError):  # the plan says what is wrong
            job = Workspace(self.root).job(self.name, [])
            self.tracks.update(job.action, job.settings.params.keypoints, counts)

    def _make_plan(self) -> None:
        revision, _ = self._latest
        stages: list[dict[str, Any]] = []
        notes: list[str] = []
        fault = None
        try:
            stages = [
                {"stage": s.stage, "state": s.state, "why": s.why}
                for s in status(self.name, root=self.root)
            ]
            notes = [self.plain(note) for note in repeated_files(self._valid)]
        except (ImocapError, OSError, ValueError) as error:
            fault = self.plain(str(error))
        self._plan = RunPlan(revision, stages, notes, fault)

    def _detect(self) -> None:
        def progress(stage: str, share: float, what: str) -> None:
            if self._stopping.is_set():
                raise WorkFailed("stopped")
            self.detection = Detection("running", share, what)

        try:
            detect(self.name, root=self.root, progress=progress)
        except ImocapError as error:
            self.detection = Detection("failed", 0.0, self.plain(str(error)))
        else:
            self.detection = Detection("done", 1.0, "")
