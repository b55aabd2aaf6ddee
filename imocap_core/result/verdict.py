"""The verdict on an action whose artifacts are in a store."""

from __future__ import annotations

from imocap_core.adapters.redetection import with_redetected
from imocap_core.artifacts.schemas import CameraMotion, Keypoints, Redetect, RefineSync, Uncertainty
from imocap_core.diagnostics.action_verdict import verdict_of
from imocap_core.diagnostics.findings import Verdict
from imocap_core.result.artifacts import Artifacts


def verdict_of_artifacts(artifacts: Artifacts) -> Verdict | None:
    """The verdict; None before the stage refine_sync has run."""
    keypoints, refined = artifacts.find(Keypoints), artifacts.find(RefineSync)
    if keypoints is None or refined is None:
        return None
    cameras, again = artifacts.find(CameraMotion), artifacts.find(Redetect)
    if cameras is not None and again is not None:
        keypoints, cameras = with_redetected(keypoints, cameras, again)
    return verdict_of(keypoints, cameras, refined, artifacts.find(Uncertainty))
