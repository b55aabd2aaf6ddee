"""The contract of a stage: read -> call the core -> write.

A part of a result that less than the whole determines is stored under a key of its own: the stage's
code, parameters and seed, and what the part is made from. Whoever needs it again finds it: the same
action after a video was added, or another action that has the video.

A stage is one script with one function; examples/visibility.py is one. What it reads is declared in
pipeline.yaml, nowhere else.

What the runner promises:

* `run` is called only when something that it reads has changed: its code (followed through the
  imports inside this project), its groups of parameters, the seed, the content of its inputs, the
  files and declarations it lists under `reads`. `ctx` refuses what is not listed.
* What it returns is validated and stored, whole or not at all.
* Bad input is a ValueError (or OSError) with a clear sentence: which file, which field, expected,
  got, what to do. It ends the run with exit code 1 and no traceback.
* The same seed and the same inputs must give the same artifact: `ctx.rng()` is the only source of
  chance; no clock, no absolute path, no global generator.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from imocap_core import errors
from imocap_core.artifacts.store import Store, mark_used
from imocap_core.pipeline.action import (
    DETECT,
    Action,
    AnchorEntry,
    Declaration,
    ForbiddenEntry,
    path_of,
    placed,
)
from imocap_core.pipeline.source import content_digest, module_name

if TYPE_CHECKING:
    import numpy as np

    from imocap_core.artifacts.schemas.base import Artifact
    from imocap_core.artifacts.store import Stored


FORMAT = 1  # raise when the way artifacts are made or stored changes what they mean


@dataclass(frozen=True)
class Recipe:
    """Everything that determines a result; every leaf is a value or a digest."""

    code: Mapping[str, str]  # module -> digest
    params: Mapping[str, Mapping[str, Any]]
    seed: int
    inputs: Mapping[str, str]  # stage -> content digest
    reads: Mapping[str, str]  # "videos v1" -> content digest
    format: int = FORMAT

    @property
    def key(self) -> str:
        """The stage key."""
        return hashlib.sha256(canonical(asdict(self)).encode()).hexdigest()

    def provenance(self) -> dict[str, str]:
        """The recipe as text, to be stored with a result."""
        return {name: canonical(value) for name, value in asdict(self).items()}


def canonical(value: Any) -> str:
    """Equal values as equal text (JSON)."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


Kind = TypeVar("Kind", bound="Artifact")


@dataclass(frozen=True)
class Parts:
    """The stored parts of one stage's results.

    Attributes:
        recipe: of the whole result; again: make every part, even one that is stored.
    """

    store: Store
    action: str
    stage: str
    recipe: Recipe
    again: bool = False

    def get(
        self,
        name: str,
        made_from: Mapping[str, Artifact | str],
        kind: type[Kind],
        make: Callable[[], Kind],
    ) -> Kind:
        """The part of this name that is made from nothing but ``made_from``: stored, or made now.

        made_from: artifacts, and digests or values as text.
        """
        from imocap_core.artifacts import codec

        digests = {
            title: value if isinstance(value, str) else codec.pack(value).digest
            for title, value in made_from.items()
        }
        recipe = replace(self.recipe, inputs=digests, reads={})
        folder = f"{self.stage}_{name}"
        stored = None if self.again else self.store.find(self.action, folder, recipe.key)
        if stored is None:
            stored = self.store.put(folder, recipe.key, make(), recipe.provenance(), {})
        mark_used(self.store.folder, folder, stored.key)
        return stored.decode(kind)


Read = Literal[
    "declarations", "detections", "videos", "sound", "initial", "hints", "event", "truth"
]
Progress = Callable[[float, str], None]  # share done (0 to 1), what is being done


@dataclass(frozen=True)
class Context:
    """What a stage can read of the action: only the kinds that its `reads` lists."""

    stage: str
    seed: int
    reads: frozenset[Read]
    progress: Progress
    report: Path  # an empty folder; what the stage leaves there is published as report/
    _action: Action
    _parts: Parts | None = None
    device: str = "cpu"  # where tensors are computed; no part of the key

    def rng(self) -> np.random.Generator:
        """A fresh generator, the same for every run of this stage with this seed."""
        import numpy as np

        return np.random.default_rng([self.seed, *self.stage.encode()])

    def part(
        self,
        name: str,
        made_from: Mapping[str, Artifact | str],
        kind: type[Kind],
        make: Callable[[], Kind],
    ) -> Kind:
        """A part of the result that nothing but ``made_from``, the stage's code, parameters and
        seed determine: kept from an earlier result, of any action, or made now."""
        if self._parts is None:
            return make()
        return self._parts.get(name, made_from, kind, make)

    def declarations(self) -> tuple[Declaration, ...]:
        """The videos as action.yaml declares them, with their files inside the action's folder
        (`places`), so that results do not depend on where they lie (reads: declarations)."""
        self._must_read("declarations")
        return placed(self._action.videos)

    def action_file(self) -> Path:
        """Path of action.yaml, for messages."""
        return self._action.file

    def detections(self, video_id: str) -> Path | None:
        """Folder or file of a video's 2D detections (reads: detections); None when not given."""
        self._must_read("detections")
        return self._given_or_detected(video_id, self._declared(video_id).keypoints)

    def video(self, video_id: str) -> Path | None:
        """A video file (reads: videos); None when action.yaml gives none."""
        self._must_read("videos")
        return self._path(self._declared(video_id).video)

    def event_sound(self) -> dict[str, Path | None] | None:
        """The video files, for their sound (reads: sound); None unless action.yaml says that all
        videos show one event."""
        self._must_read("sound")
        if not self._action.event:
            return None
        return {video.id: self._path(video.video) for video in self._action.videos}

    def event(self) -> bool | None:
        """Whether action.yaml says that all videos show one event (reads: event), or None."""
        self._must_read("event")
        return self._action.event

    def initial(self, video_id: str) -> Path | None:
        """File or folder of a monocular estimator's result (reads: initial), or None."""
        self._must_read("initial")
        return self._given_or_detected(video_id, self._declared(video_id).initial)

    def initial_digest(self, video_id: str) -> str:
        """Digest of what `initial` gives (reads: initial); empty where it gives nothing."""
        path = self.initial(video_id)
        return "" if path is None else content_digest(path)

    def hints(self) -> tuple[tuple[AnchorEntry, ...], tuple[ForbiddenEntry, ...]]:
        """Anchors and forbidden spans of action.yaml, in source frames (reads: hints)."""
        self._must_read("hints")
        return self._action.anchors, self._action.forbidden

    def mirrored(self) -> dict[str, bool | None]:
        """`mirrored` of each video in action.yaml, None where not given (reads: hints)."""
        self._must_read("hints")
        return {video.id: video.mirrored for video in self._action.videos}

    def truth(self) -> Path | None:
        """truth.npz, for scoring only (reads: truth, which only evaluate may)."""
        self._must_read("truth")
        return self._path(self._action.truth)

    def _must_read(self, kind: Read) -> None:
        if kind not in self.reads:
            raise _older_pipeline(self.stage, "reads", kind, self.reads)

    def _declared(self, video_id: str) -> Declaration:
        for declaration in self._action.videos:
            if declaration.id == video_id:
                return declaration
        ids = ", ".join(v.id for v in self._action.videos)
        raise ValueError(f"{self._action.file}: unknown video {video_id!r}; expected one of {ids}")

    def _given_or_detected(self, video_id: str, given: str | None) -> Path | None:
        """The path in action.yaml, or the file of detections where it says `detect`."""
        return self._action.detected.get(video_id) if given == DETECT else self._path(given)

    def _path(self, given: str | None) -> Path | None:
        return None if given is None else path_of(self._action.folder, given)


@dataclass(frozen=True)
class Inputs:
    """The artifacts that a stage declares as inputs, decoded on request."""

    stage: str
    _stored: dict[str, Stored]
    _decoded: dict[type[Artifact], Artifact] = field(default_factory=dict)

    def get(self, kind: type[Kind]) -> Kind:
        """The input artifact of this class: `inputs.get(Keypoints)`."""
        if kind not in self._decoded:
            matching = [s for s in self._stored.values() if s.schema == kind.__name__]
            if len(matching) != 1:
                raise _older_pipeline(self.stage, "inputs", f"one {kind.__name__}", self._stored)
            self._decoded[kind] = matching[0].unread().decode(kind)
        artifact = self._decoded[kind]
        assert isinstance(artifact, kind)
        return artifact

    def with_artifacts(self, *artifacts: Artifact) -> Inputs:
        """The same inputs, with some artifacts in the place of those that are stored."""
        return Inputs(self.stage, self._stored, self._decoded | {type(a): a for a in artifacts})

    def forget(self, kind: type[Artifact]) -> None:
        """Hold a large input no longer; asked for again it is read again."""
        self._decoded.pop(kind, None)


def _older_pipeline(stage: str, field: str, wanted: str, got: Iterable[str]) -> errors.WorkFailed:
    return errors.WorkFailed(
        f"pipeline.yaml: stages.{stage}.{field}: expected {wanted} among them, because the stage "
        f"reads it, got {', '.join(got) or 'none'}; a pipeline.yaml of an older version is "
        "replaced by this version's, or removed"
    )


Made = TypeVar("Made")


def returned_artifact(result: object) -> Artifact:
    """What a stage's `run` returned. AssertionError where that is no artifact."""
    from imocap_core.artifacts.schemas.base import Artifact

    assert isinstance(result, Artifact), f"returned a {type(result).__name__}"
    return result


def in_a_sentence(stage: str, call: Callable[[], Made]) -> Made:
    """Call a stage's function; every error in it becomes WorkFailed with one sentence."""
    try:
        return call()
    except (ValueError, errors.ArtifactCorrupt, errors.WorkFailed) as error:
        raise errors.WorkFailed(f"{stage}: {error}") from error
    except OSError as error:
        raise errors.WorkFailed(f"{stage}: {errors.system_fault(error)}") from error
    except Exception as error:
        if errors.is_out_of_memory(error):
            fault = errors.system_fault(MemoryError())
            raise errors.WorkFailed(f"{stage}: {fault}") from MemoryError(str(error))
        raise errors.WorkFailed(f"{stage} broke: {errors.program_fault(error)}") from error


def load_script(script: Path) -> ModuleType:
    """A stage's script, imported only when the stage runs."""
    module = module_name(script)
    if module:
        return importlib.import_module(module)
    spec = importlib.util.spec_from_file_location(f"imocap_stage_{script.stem}", script)
    assert spec is not None
    assert spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


class DeclaredParams:
    """The groups of parameters that a stage declares; AttributeError for any other."""

    def __init__(self, stage: str, groups: Mapping[str, Any]) -> None:
        self._stage, self._groups = stage, groups

    def __getattr__(self, group: str) -> Any:
        if group.startswith("_") or group not in self._groups:
            raise AttributeError(
                f"stage {self._stage} wants params.{group}, which pipeline.yaml does not list "
                f"for it"
            )
        return self._groups[group]
