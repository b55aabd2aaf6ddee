"""`imocap.Result`, with its files for other programs, and `imocap.load`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from imocap_core.artifacts.store import Store
from imocap_core.diagnostics.findings import Verdict
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.library.api_errors import plain_errors
from imocap_core.pipeline.action import FILE_NAME, Action
from imocap_core.result.artifacts import artifacts_in_store, verdict_of_artifacts
from imocap_core.result.result import ActionResult, Time

if TYPE_CHECKING:
    from imocap_core.export.export_options import ExportOptions
    from imocap_core.export.formats import Exported
    from imocap_core.variation import Variation

MotionStage = Literal["refine_sync", "smpl_ba"]


class Result(ActionResult):
    """What a run gave: all videos of an action in one world and on one time axis.

    `result["v1"]`, `len(result)` and iteration give the videos (`VideoResult`); everything else is
    documented in `ActionResult`.
    """

    @cached_property
    def verdict(self) -> Verdict | None:
        """What to know about this result, without truth: `print(result.verdict)` gives three
        sentences, `.findings` the reasons. None before the stage refine_sync has run."""
        return verdict_of_artifacts(self.artifacts)

    @cached_property
    def variation(self) -> Variation:
        """How the performances differ: mean motion, modes of variation with every performance's
        scores, and bands of the joint angles. WorkFailed for fewer than two performances."""
        from imocap_core.compare import compare

        technique = compare.describe(compare.several(compare.performances_of(self)))
        return compare.variation_of(technique, compare.technique_angles(technique).mean)

    @plain_errors
    def export(
        self,
        format: str,
        out: str | Path,
        *,
        up: str | None = None,
        time: Time = "own",
        options: ExportOptions | None = None,
    ) -> list[Path]:
        """Write the motion, the cameras and the correspondences for other programs.

        Args:
            format: npz, amass, bvh, glb, trc, csv, mcap or another of docs/exports.md.
            out: folder to write to.
            up: y or z: level the world by the ground, this axis up; None: as usual for the format.
            time: own: every video's own frames; common: all videos in lock-step.
            options: which videos, their mean or its modes of variation, origin, names and rest pose
                of a rig, root bone.

        Returns:
            The files. WorkFailed and WrongUse as of `imocap export`.
        """
        return exported(self, format, Path(out), up, time, options).files

    @plain_errors
    def view(self, out: str | Path) -> Path:
        """Write the viewer, one HTML file that needs nothing else, and return its path."""
        from imocap_core.viewer.viewer_scene import write_viewer

        if self.time != "own":
            raise WrongUse("view: expected a result on the videos' own timelines, as it was loaded")
        file = html_file(out)
        write_viewer(self, file, lambda share, what: None)
        return file

    @plain_errors
    def film(
        self,
        out: str | Path,
        *,
        kind: Literal["overlay", "side-by-side", "both"] = "both",
        mesh: bool = True,
        motion: Literal["final", "monocular"] = "final",
        opacity: float = 0.75,
        progress: Callable[[str, float, str], object] | None = None,
    ) -> list[Path]:
        """Write films (H.264) into the folder `out`: the body over each video, and all videos in
        lock-step. opacity: 1 hides the person behind the body."""
        from imocap_core.film import Film, films_of, write_films

        if not 0 <= opacity <= 1:
            raise WrongUse(f"opacity: expected 0 to 1, got {opacity}")

        def advance(film: Film, done: int) -> None:
            if progress is not None:
                progress(film.name, done / film.count, f"frame {done}")

        films = films_of(self, kind, mesh=mesh, motion=motion, opacity=opacity)
        return write_films(films, Path(out), advance)

    @classmethod
    def of_action(cls, store: Store, action: Action, stage: MotionStage = "refine_sync") -> Result:
        """The current results of an action; WorkFailed when it has not been run."""
        from imocap_core.result.read import read_result

        artifacts = artifacts_in_store(store, action.name, action.folder)
        return read_result(artifacts, cls, action.folder, stage)


def exported(
    result: Result,
    format: str,
    out: Path,
    up: str | None,
    time: Time,
    options: ExportOptions | None,
    announce: Callable[[str], None] = lambda step: None,
) -> Exported:
    """The files of `Result.export`, and remarks; announce: called before a slow step."""
    from imocap_core.export.formats import DEFAULT, export

    chosen = options or DEFAULT
    variation = result.variation if chosen.variation else None
    return export(result, format, out, up, time, chosen, announce, variation)


@plain_errors
def load(
    path: str | Path, *, action: str | Path | None = None, stage: MotionStage = "refine_sync"
) -> Result:
    """The result of a run that exists.

    Args:
        path: the folder of its artifacts, artifacts/<action>.
        action: the folder of its action.yaml, for the videos; else looked for beside artifacts/.
        stage: refine_sync: the final motion; smpl_ba: the one before synchronisation was refined.

    Raises:
        WorkFailed: there is no such folder, or it lacks an artifact or has a damaged one.
    """
    from imocap_core.result.read import read_result

    folder = Path(path).resolve()
    if not folder.is_dir():
        raise WorkFailed(
            f"{path}: there is no such folder; expected the artifacts of a run, as in "
            f"artifacts/yoga; make them with: imocap run {folder.name}, or imocap.run()"
        )
    artifacts = artifacts_in_store(Store(folder.parent), folder.name)
    return read_result(artifacts, Result, _action_folder(folder, action), stage)


def html_file(out: str | Path) -> Path:
    """The path of a page to be written; WrongUse when it is no .html file."""
    file = Path(out)
    if file.is_dir() or file.suffix.lower() not in (".html", ".htm"):
        raise WrongUse(f"--out {out}: expected the name of an .html file")
    return file


def _action_folder(artifacts: Path, given: str | Path | None) -> Path | None:
    """The folder of an action.yaml: the one given, or where actions usually are."""
    if given is not None:
        if not (Path(given) / FILE_NAME).is_file():
            raise WorkFailed(f"action: there is no {Path(given) / FILE_NAME}")
        return Path(given).resolve()
    places = (artifacts.parent.parent / "actions" / artifacts.name, artifacts)
    return next((place for place in places if (place / FILE_NAME).is_file()), None)
