"""The page that follows a run: what there is of an action, from keypoints to the viewer."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock
from typing import Any

import cv2
import numpy as np
from bottle import Bottle, HTTPResponse  # type: ignore[import-untyped]

from imocap_core.artifacts.schemas import CameraMotion, InitialSmpl, Keypoints, RefineSync
from imocap_core.artifacts.store import Stored
from imocap_core.body import load_free_body
from imocap_core.errors import ImocapError, WorkFailed
from imocap_core.figures.overlays import Image
from imocap_core.figures.sheets import body_cells, detected_cells, read_cells, sheet_videos, spread
from imocap_core.library.api_errors import Params, one_off, plain_errors
from imocap_core.library.outputs import view
from imocap_core.library.result import Result
from imocap_core.pick import server
from imocap_core.pipeline.generation import AT_WORK, LAST_RUN
from imocap_core.result.artifacts import Artifacts, artifacts_of_stages
from imocap_core.result.read import Stage, read_result
from imocap_core.viewer.viewer_scene import unfinished_viewer
from imocap_core.workspace import Workspace, video_files

# The viewer's program, style, pictures and films are in its page.
_POLICY = (
    server.HEADERS["Content-Security-Policy"]
    .replace("'self'", "'self' 'unsafe-inline' data: blob:")
    .replace("frame-ancestors 'none'", "media-src blob:; frame-src 'self'; frame-ancestors 'self'")
)
_HEADERS = {**server.HEADERS, "Content-Security-Policy": _POLICY, "X-Frame-Options": "SAMEORIGIN"}
_HTML = "text/html; charset=utf-8"
_SHOWN = {"refine_sync": "viewer", "smpl_ba": "viewer"}
_SHOWN |= {"initial_smpl": "motion", "keypoints": "keypoints"}


class LiveAction:
    """An action whose run, at work or yet to come, is followed."""

    def __init__(self, action: str, root: Path, params: Params) -> None:
        self._params, self._root = one_off(params), root
        self._job = Workspace(root).job(action, self._params)
        self.name = self._job.action.name
        self._drawing = Lock()  # one picture or viewer at a time
        self._drawn: dict[str, bytes] = {}
        self._known: tuple[str | None, dict[str, Any]] = (None, {})

    def document(self) -> dict[str, Any]:
        """What a run does now, in a sentence, and what is there to be shown.

        shown: nothing, keypoints, motion (of each video alone) or viewer; stamp: changes when that
        does. share: of the stage at work. videos, rounds: see `_facts`.
        """
        doing, stored = self._doing(), self._stored()
        shown, of = _shown(stored)
        stamp = f"{of} {stored[of].digest}" if of else ""
        if stamp != self._known[0]:
            self._known = (stamp, _facts(self.name, stored))
        return {
            "action": self.name,
            "sentence": self._sentence(doing, stored),
            "stages": [
                {"name": s.replace("_", " "), "made": s in stored, "now": doing.get("stage") == s}
                for s in self._job.pipeline.stages
            ],
            "share": doing.get("share"),
            "shown": shown,
            "stamp": f"{stamp} {bool(doing)}",
            **self._known[1],
        }

    def _doing(self) -> dict[str, Any]:
        """What the run at work does: stage, share, what; empty without a run."""

        def busy() -> None:
            raise WorkFailed("a run is at work")

        folder = self._job.store.folder / self.name
        with suppress(OSError, ValueError):
            doing: dict[str, Any] = json.loads((folder / AT_WORK).read_text(encoding="utf-8"))
            try:
                with self._job.store.lock(self.name, busy):
                    return {}  # it was killed
            except WorkFailed:
                return doing
        return {}

    def _stored(self) -> dict[str, Stored]:
        """The results that are there of one run, up to the stage at work."""
        now, store = self._doing().get("stage"), self._job.store
        artifacts = Artifacts(self.name, lambda stage: store.load(self.name, stage), "")
        stored: dict[str, Stored] = {}
        for stage in self._job.pipeline.stages:
            if stage == now:
                break
            try:
                result = artifacts.stored(stage)
            except ImocapError:  # of another run
                break
            if result is None:
                break
            stored[stage] = result
        return stored

    def _sentence(self, doing: dict[str, Any], stored: dict[str, Stored]) -> str:
        run = f"imocap run {self.name}"
        if doing:
            parts = (doing["stage"].replace("_", " "), doing["what"])
            return f"The run is at work, {': '.join(filter(None, parts))}"
        if "refine_sync" in stored:
            return "The run has ended."
        with suppress(OSError, ValueError):
            record = self._job.store.folder / self.name / LAST_RUN
            error = json.loads(record.read_text(encoding="utf-8")).get("error")
            if error:
                return f"The last run ended: {error}"
        there = "The last run ended before the motion" if stored else "Nothing has been made yet"
        return f"{there}. This page follows: {run}"

    def strip(self, number: int) -> bytes:
        """Some frames of a video with its keypoints, or with the body that it alone shows: JPEG."""
        artifacts = artifacts_of_stages(self.name, self._stored())
        with self._drawing:
            rgb = _strip(artifacts, video_files(self._job.action), number)
        return cv2.imencode(".jpg", rgb[:, :, ::-1])[1].tobytes()

    def viewer(self) -> bytes:
        """The final viewer; while a run is at work, one of the motion so far."""
        stored = self._stored()
        with self._drawing:
            if not self._doing():
                made = view(self._job.action.folder, root=self._root, params=self._params)
                if made.file is not None:
                    return made.file.read_bytes()
            stage = _shown(stored)[1]
            digest = stored[stage].digest
            if digest not in self._drawn:
                artifacts = artifacts_of_stages(self.name, stored)
                of: Stage = "refine_sync" if stage == "refine_sync" else "smpl_ba"
                result = read_result(artifacts, Result, self._job.action.folder, of)
                self._drawn = {digest: unfinished_viewer(result).encode()}
            return self._drawn[digest]


def _facts(action: str, stored: dict[str, Stored]) -> dict[str, Any]:
    """The ids of the videos, and cost and change (frames) of each round of the loop."""
    artifacts = artifacts_of_stages(action, stored)
    keypoints, refined = artifacts.find(Keypoints), artifacts.find(RefineSync)
    rounds = [] if refined is None else refined.rounds
    return {
        "videos": [] if keypoints is None else [video.id for video in keypoints.videos],
        "rounds": [{"cost": r.cost, "change": r.sync_change_frames} for r in rounds],
    }


def _shown(stored: dict[str, Stored]) -> tuple[str, str]:
    """What can be shown, and the stage that it is of; none where nothing can."""
    return next(((what, s) for s, what in _SHOWN.items() if s in stored), ("nothing", ""))


def _strip(artifacts: Artifacts, files: dict[str, Path | None], number: int) -> Image:
    keypoints, initial = artifacts.get(Keypoints), artifacts.find(InitialSmpl)
    video, model = keypoints.videos[number], load_free_body()
    frames = [int(t) for t in spread(len(video.frames))]
    cells, cuts = read_cells(video, files.get(video.id), frames)
    if initial is None:
        names = model.points(video.layout).names
        return np.hstack(list(detected_cells(video, names, frames, cells, cuts).values()))
    cameras = artifacts.get(CameraMotion)
    sheet = sheet_videos(keypoints, cameras, initial, None, files, model)[number]
    return np.hstack(body_cells(sheet, sheet.final, sheet.K, model, frames, cells, cuts)[0])


def routes(live: LiveAction) -> Bottle:
    """The application."""
    app = Bottle()
    app.catchall = False
    page = server.page_files()["live.html"]
    app.route("/", "GET", lambda: server.response(200, page, _HTML))
    app.route("/state", "GET", lambda: _answer(lambda: server.json_response(live.document())))
    app.route(
        "/strips/<number:int>.jpg",
        "GET",
        lambda number: _answer(lambda: server.response(200, live.strip(number), "image/jpeg")),
    )
    app.route(
        "/viewer.html", "GET", lambda: _answer(lambda: server.response(200, live.viewer(), _HTML))
    )
    app.default_error_handler = server.nothing_here
    return app


def _answer(make: Callable[[], HTTPResponse]) -> HTTPResponse:
    """What is asked for; a sentence where it is not there, as when a run has just begun anew."""
    try:
        return make()
    except (ImocapError, IndexError, KeyError) as error:
        return server.error_response(404, str(error))


@contextmanager
def following(
    action: str, root: Path, params: Params = None, fault: Callable[[str], None] = print
) -> Iterator[server.Served]:
    """Serve the page of an action's run while the body runs.

    params: those that the run is made with. fault: called with a sentence about a fault of the
    program. WrongUse when there is no such action.
    """
    live = plain_errors(LiveAction)(action, root, params)
    with server.serving(lambda end: routes(live), 0, fault, headers=_HEADERS) as served:
        yield served
