"""The artifacts of one action, read when first asked for, and the run that they are of."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from imocap_core.artifacts.schemas import (
    CameraMotion,
    Evaluate,
    Hands,
    InitialSmpl,
    Keypoints,
    Redetect,
    RefineSync,
    SmplBa,
    Sync,
    Uncertainty,
)
from imocap_core.artifacts.schemas.base import Artifact
from imocap_core.artifacts.store import Store, Stored
from imocap_core.errors import ArtifactCorrupt, WorkFailed

if TYPE_CHECKING:
    from imocap_core.diagnostics.findings import Verdict

STAGE_OF: Mapping[type[Artifact], str] = {
    Keypoints: "keypoints",
    CameraMotion: "camera_motion",
    InitialSmpl: "initial_smpl",
    Sync: "sync",
    SmplBa: "smpl_ba",
    Redetect: "redetect",
    RefineSync: "refine_sync",
    Uncertainty: "uncertainty",
    Hands: "hands",
    Evaluate: "evaluate",
}
Kind = TypeVar("Kind", bound=Artifact)


class Artifacts:
    """What the stages of one action gave.

    Args:
        action: its name.
        read: gives a stage's artifact from a store, or None when that stage has not run.
        advice: ends messages, as in "run it with: imocap run yoga".
    """

    def __init__(self, action: str, read: Callable[[str], Stored | None], advice: str) -> None:
        self.action, self.advice = action, advice
        self._read = read
        self._stored: dict[str, Stored | None] = {}
        self._decoded: dict[type[Artifact], Artifact] = {}

    def get(self, kind: type[Kind]) -> Kind:
        """The artifact of a class, as in get(Keypoints). WorkFailed when missing or damaged."""
        artifact = self.find(kind)
        if artifact is None:
            raise WorkFailed(f"{self.action} has no {STAGE_OF[kind]} artifact yet; {self.advice}")
        return artifact

    def find(self, kind: type[Kind]) -> Kind | None:
        """The artifact of a class; None when its stage has not run. WorkFailed when damaged."""
        if kind not in self._decoded:
            stage = STAGE_OF[kind]
            stored = self.stored(stage)
            if stored is None:
                return None
            try:
                self._decoded[kind] = stored.decode(kind)
            except ArtifactCorrupt as error:
                raise WorkFailed(self._damaged(stage, error)) from None
        artifact = self._decoded[kind]
        assert isinstance(artifact, kind)
        return artifact

    def stored(self, stage: str) -> Stored | None:
        """A stage's artifact before decoding; None when the stage has not run."""
        if stage not in self._stored:
            try:
                stored = self._read(stage)
                if stored is not None:
                    self._must_be_of_one_run(stage, stored)
                self._stored[stage] = stored
            except ArtifactCorrupt as error:
                raise WorkFailed(self._damaged(stage, error)) from None
        return self._stored[stage]

    def _must_be_of_one_run(self, stage: str, stored: Stored) -> None:
        """WorkFailed when it was made from another than one read before, or that from another."""
        for other, present in self._stored.items():
            if present is None:
                continue
            pairs = ((stage, stored, other, present), (other, present, stage, stored))
            for made, result, given, source in pairs:
                inputs = json.loads(result.content.provenance.get("inputs", "{}"))
                if inputs.get(given, source.digest) != source.digest:
                    raise WorkFailed(
                        f"{self.action}: {made} was made from another {given} than the one beside "
                        f"it, so they are of different runs; {self.advice}"
                    )

    def _damaged(self, stage: str, error: ArtifactCorrupt) -> str:
        return f"{stage} of {self.action}: {str(error).splitlines()[0]}; {self.advice}"


def artifacts_in_store(store: Store, action: str, folder: Path | None = None) -> Artifacts:
    """The current artifacts of an action; `folder`: of its action.yaml, when that is known."""
    by_name = folder is None or folder.parent.name == "actions"
    advice = f"run it with: imocap run {action if by_name else folder}"
    return Artifacts(action, lambda stage: store.load(action, stage), advice)


def artifacts_of_stages(
    action: str, stored: Mapping[str, Stored], advice: str | None = None
) -> Artifacts:
    """The artifacts of the stages of one run, by stage."""
    return Artifacts(action, stored.get, advice or f"run it with: imocap run {action}")


RECIPE = ("seed", "params")


def run_record(artifacts: Artifacts) -> dict[str, Any]:
    """As plain data: `seed`, `params` (group -> name -> value) and `stages` (stage -> key of its
    recipe and digest of its content), of the stages whose results were stored by a run."""
    record: dict[str, Any] = {"seed": None, "params": {}, "stages": {}}
    for stage in STAGE_OF.values():
        stored = artifacts.stored(stage) if stage != "evaluate" else None
        if stored is None:
            continue
        record["stages"][stage] = {"key": stored.key, "digest": stored.digest}
        seed, params = (json.loads(stored.content.provenance.get(name, "null")) for name in RECIPE)
        record["seed"] = seed if record["seed"] is None else record["seed"]
        record["params"] |= params or {}
    return record


def verdict_of_artifacts(artifacts: Artifacts) -> Verdict | None:
    """The verdict on an action; None before the stage refine_sync has run."""
    from imocap_core.adapters.redetection import with_redetected
    from imocap_core.diagnostics.action_verdict import verdict_of

    keypoints, refined = artifacts.find(Keypoints), artifacts.find(RefineSync)
    if keypoints is None or refined is None:
        return None
    cameras, again = artifacts.find(CameraMotion), artifacts.find(Redetect)
    if cameras is not None and again is not None:
        keypoints, cameras = with_redetected(keypoints, cameras, again)
    return verdict_of(keypoints, cameras, refined, artifacts.find(Uncertainty))
