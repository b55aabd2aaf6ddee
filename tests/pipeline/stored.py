"""A made action on disk: its artifacts in a store, its action.yaml, and videos where wanted."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from imocap_core.artifacts.schemas import Evaluate, Hands, Keypoints, Table
from imocap_core.artifacts.schemas.base import Artifact
from imocap_core.artifacts.schemas.sync_schemas import SyncSummary
from imocap_core.io.video import write_h264
from imocap_core.pipeline.keys import recipe
from imocap_core.pipeline.runner import Job
from imocap_core.report.table_files import CONTENTS
from imocap_core.workspace import Workspace
from tests.report.made import FPS, SIZE, Made

NAME = "waving"
INDEX = json.dumps({"title": NAME, "pictures": []}).encode()  # of a report


def stored_job(root: Path, made: Made, *, filmed: tuple[str, ...] = ()) -> Job:
    """The made scene as an action that has been run; the videos of `filmed` are grey pictures."""
    folder = root / "actions" / NAME
    folder.mkdir(parents=True)
    videos = []
    (folder / "k").write_text("keypoints")
    for seen in made.keypoints.videos:
        entry = {"id": seen.id, "keypoints": "k", "fps": FPS, "size": list(SIZE)}
        if seen.id in filmed:
            pictures = (np.full((SIZE[1], SIZE[0], 3), 10 * n, np.uint8) for n in range(24))
            write_h264(folder / f"{seen.id}.mp4", pictures, FPS)
            entry["video"] = f"{seen.id}.mp4"
        videos.append(entry)
    (folder / "action.yaml").write_text(yaml.safe_dump({"name": NAME, "videos": videos}))
    put(root, made, filmed)
    return Workspace(root).job(NAME, [])


def publish(
    root: Path,
    action: str,
    stage: str,
    artifact: Artifact,
    files: dict[str, bytes] | None = None,
    sets: Sequence[str] = (),
) -> None:
    """Store an artifact as a run would: made from the action's files, and from the results there
    are."""
    job = Workspace(root).job(action, list(sets))
    done = {s: r for s in job.pipeline.stages if (r := job.store.load(action, s)) is not None}
    inputs = {s: done[s].digest for s in job.pipeline.stages[stage].inputs if s in done}
    made = recipe(job.pipeline, stage, job.action, job.settings, inputs)
    stored = job.store.put(stage, made.key, artifact, made.provenance(), files or {})
    job.store.publish(action, stage, stored)


def put(root: Path, made: Made, filmed: tuple[str, ...] = ()) -> None:
    """Every stage's artifact, as a run would have made them."""
    keypoints = Keypoints(
        videos=[
            v.model_copy(update={"video": f"{v.id}.mp4"}) if v.id in filmed else v
            for v in made.keypoints.videos
        ]
    )
    pose = Table(
        name="summary",
        title="In short",
        columns=["result", "mpjpe_mm"],
        rows=[["monocular", 90.0], ["after loop", 30.0]],
    )
    rounds = [r.model_copy(update={"sync": _summary(r.sync)}) for r in made.refined.rounds]
    parts: dict[str, tuple[Artifact, dict[str, bytes]]] = {
        "keypoints": (keypoints, {}),
        "camera_motion": (made.camera_motion, {}),
        "initial_smpl": (made.initial, {}),
        "sync": (made.sync, {}),
        "smpl_ba": (made.single, {}),
        "redetect": (made.again, {}),
        "refine_sync": (made.refined.model_copy(update={"rounds": rounds}), {}),
        "uncertainty": (made.claimed, {}),
        "hands": (Hands(videos=[], model="", model_digest="", size=1.0, status="none"), {}),
        "evaluate": (Evaluate(tables=[pose], files=[CONTENTS]), {CONTENTS: INDEX}),
    }
    for stage, (artifact, files) in parts.items():
        publish(root, NAME, stage, artifact, files)


def _summary(sync: SyncSummary) -> SyncSummary:
    """Without the matrices, as the stage writes rounds."""
    return SyncSummary(**{name: getattr(sync, name) for name in SyncSummary.model_fields})
