"""One use of `imocap pick`: an action.yaml, its videos, and what goes on in the background."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from shlex import join
from threading import Thread
from typing import Any

from imocap_core.errors import ImocapError, WorkFailed
from imocap_core.library.people import detect
from imocap_core.library.status import status
from imocap_core.pick.action_file import ActionFile, Version
from imocap_core.pick.background import END_S, BackgroundThread
from imocap_core.pick.changes import person_fields
from imocap_core.pick.contradictions import warnings_of
from imocap_core.pick.media import Media
from imocap_core.pick.tracks import Tracks
from imocap_core.pipeline.action import Declaration
from imocap_core.pipeline.repeated_files import repeated_files
from imocap_core.workspace import Workspace


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
        counts = {v.id: self._count(v) for v in self._valid.videos}
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
        plan = self._plan
        if version is None or plan is None or plan.revision != version.revision:
            plan = None
        return {
            "action": action.name,
            "name": self.name,
            "file": self._short_name(),
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

    def _count(self, video: Declaration) -> int | None:
        path = self._path(video)
        return None if path is None else self.media.count(path)

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

    def _short_name(self) -> str:
        """The path of action.yaml, below the working folder where it lies in it."""
        file, root = self.file.file.resolve(), self.root.resolve()
        return str(file.relative_to(root) if file.is_relative_to(root) else file)

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
