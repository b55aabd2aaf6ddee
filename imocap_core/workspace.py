"""The working folder: actions/ and artifacts/ below it, and the pipeline.yaml in force."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from imocap_core.artifacts.file_memory import load_memory
from imocap_core.artifacts.side_files import refuse_links
from imocap_core.artifacts.store import CACHE, Store
from imocap_core.errors import WorkFailed
from imocap_core.pipeline import builtin_actions as demos
from imocap_core.pipeline.action import DETECT, Action, find_action, path_of, read_action
from imocap_core.pipeline.action import FILE_NAME as ACTION
from imocap_core.pipeline.graph import FILE_NAME as PIPELINE
from imocap_core.pipeline.graph import Pipeline, read_pipeline, settings
from imocap_core.pipeline.runner import Display, Job
from imocap_core.pipeline.source import PROJECT
from imocap_core.process import CPU, check_device


@dataclass(frozen=True)
class Workspace:
    """The working folder, and what belongs to it.

    device: where stages compute their tensors (pipeline/device.py).
    """

    root: Path
    device: str = CPU

    @property
    def store(self) -> Store:
        """The artifacts of this folder."""
        return Store(self.root / "artifacts")

    def pipeline_file(self) -> Path:
        """This folder's own pipeline.yaml, else the checkout's, else the one that is installed."""
        places = (self.root / PIPELINE, PROJECT / PIPELINE, PROJECT / "imocap_core" / PIPELINE)
        for place in places:
            if place.is_file():
                return place
        raise WorkFailed(f"there is no {PIPELINE}, neither in {self.root} nor beside the program")

    def pipeline(self) -> Pipeline:
        """The graph in force."""
        return read_pipeline(self.pipeline_file())

    def job(self, action: str, sets: list[str]) -> Job:
        """An action (by name or path) with its settings, its files not yet checked."""
        if action in demos.BUILT_IN and not (self.root / "actions" / action).exists():
            raise WorkFailed(f"{action} is built in but not made yet; make it: imocap run {action}")
        load_memory(self.store.folder)
        declared = read_action(find_action(action, self.root))
        refuse_links(self.store.folder, declared.name, CACHE)
        pipeline = self.pipeline()
        chosen = settings(pipeline, declared.params, declared.file, sets)
        if any(video.detected for video in declared.videos):
            from imocap_core.detect.detected_action import with_detections

            declared = with_detections(declared, chosen.params.detect, self.store)
        return Job(pipeline, self.store, declared, chosen, self.device)

    def ready_job(self, action: str, sets: list[str], display: Display) -> Job:
        """The same for running: a built-in action is made first, every file must be there, and
        people are detected where action.yaml says `keypoints: detect`.

        WrongUse where PyTorch has no such device here.
        """
        check_device(self.device)
        load_memory(self.store.folder)
        if action in demos.BUILT_IN:
            folder = self.root / "actions" / action
            settings(self.pipeline(), {}, folder, sets)  # a fault in them is named at once
            with self.store.lock(action, display.waiting):
                demos.ensure(action, folder, self.pipeline().seed, display)
        job = self.job(action, sets)
        check_files(job.action)
        if len(job.action.detected) == sum(video.detected for video in job.action.videos):
            return job
        from imocap_core.detect.detected_action import detect

        with self.store.lock(job.action.name, display.waiting):
            detect(job.action, job.settings.params.detect, self.store, display)
        return self.job(action, sets)


def is_action(root: Path, word: str) -> bool:
    """Whether a word names an action of a working folder, or an action's folder or file."""
    places = (root / "actions" / word / ACTION, Path(word) / ACTION)
    return word in demos.BUILT_IN or Path(word).name == ACTION or any(p.is_file() for p in places)


def video_files(action: Action) -> dict[str, Path | None]:
    """Each video's file; None where action.yaml names none, or it is not there."""
    named = {v.id: path_of(action.folder, v.video) for v in action.videos if v.video is not None}
    there = {video: file for video, file in named.items() if file.is_file()}
    return {v.id: there.get(v.id) for v in action.videos}


def check_files(action: Action) -> None:
    """WorkFailed, one sentence per fault, when a file that the action names is not there."""
    blind = [v.id for v in action.videos if v.keypoints is None]
    if blind:
        one = len(blind) == 1
        raise WorkFailed(
            f"{action.file}: {'video' if one else 'videos'} {', '.join(blind)} "
            f"{'has' if one else 'have'} no keypoints: write `keypoints: {DETECT}` there to have "
            f"people found, or name what a 2D pose detector (OpenPose, for example) wrote"
        )
    named = [
        (f"videos.{i}.{field}", given)
        for i, video in enumerate(action.videos)
        for field in ("video", "keypoints", "initial")
        if (given := getattr(video, field)) not in (None, DETECT)
    ]
    named += [("truth", action.truth)] if action.truth is not None else []
    missing = [(field, given) for field, given in named if not (action.folder / given).exists()]
    if missing:
        raise WorkFailed(
            "\n".join(f"{action.file}: {f}: {_why_missing(action.folder, g)}" for f, g in missing)
        )


def _why_missing(folder: Path, given: str) -> str:
    """A sentence on a path that leads nowhere, with what was probably meant."""
    path = path_of(folder, given)
    if "://" in given:
        return f"{given} is an address; download the file and name it here"
    if (folder / given.replace("\\", "/")).exists():
        return f"there is no {path}; write / instead of \\"
    if given.startswith("~"):
        return f"there is no {path}; write the whole path instead of ~"
    alike = [f.name for f in path.parent.glob("*") if f.name.casefold() == path.name.casefold()]
    return f"there is no {path}" + (f"; there is {alike[0]}" if alike else "")
