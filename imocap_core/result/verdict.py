"""The verdict on an action whose artifacts are in a store."""

from __future__ import annotations

from imocap_core.artifacts.schemas import CameraMotion, Keypoints, RefineSync, Uncertainty
from imocap_core.result.artifacts import Artifacts
from imocap_core.verdict.action_verdict import verdict_of
from imocap_core.verdict.findings import Verdict


def verdict_of_artifacts(artifacts: Artifacts) -> Verdict | None:
    """The verdict; None before the stage refine_sync has run."""
    keypoints, refined = artifacts.find(Keypoints), artifacts.find(RefineSync)
    if keypoints is None or refined is None:
        return None
    return verdict_of(keypoints, artifacts.find(CameraMotion), refined, artifacts.find(Uncertainty))
