"""Stages whose scripts lie in a working folder are run only where their user has allowed it.

A pipeline.yaml names scripts, and a working folder may come from somebody else. Scripts of this
program always run; those of a folder when IMOCAP_ALLOW_SCRIPTS lists that folder (`--allow-scripts`
adds the working folder for one command).
"""

from __future__ import annotations

import os
from pathlib import Path

from imocap_core.errors import WorkFailed
from imocap_core.pipeline.graph import Pipeline
from imocap_core.pipeline.source import module_name

VARIABLE = "IMOCAP_ALLOW_SCRIPTS"


def foreign_scripts(pipeline: Pipeline) -> list[Path]:
    """Scripts of a pipeline that are no part of this program and that nobody has allowed."""
    if _folder(pipeline) in _allowed():
        return []
    scripts = (pipeline.script(stage) for stage in pipeline.stages)
    return [script for script in scripts if not module_name(script)]


def allow_scripts(folder: Path) -> None:
    """Allow the scripts of a working folder, in this process and those that it starts."""
    given = os.environ.get(VARIABLE)
    places = [given] if given else []
    os.environ[VARIABLE] = os.pathsep.join([*places, str(folder.resolve())])


def must_be_allowed(pipeline: Pipeline, stage: str) -> None:
    """WorkFailed when a stage's script is foreign; nothing of it has been run then."""
    script = pipeline.script(stage)
    if script in foreign_scripts(pipeline):
        raise WorkFailed(
            f"{pipeline.file}: stages.{stage}.script: {script} is no part of imocap, and would run "
            f"with your rights. Read it; if you trust it, add --allow-scripts, or set "
            f"{VARIABLE}={_folder(pipeline)}"
        )


def _folder(pipeline: Pipeline) -> Path:
    return pipeline.file.parent.resolve()


def _allowed() -> set[Path]:
    places = os.environ.get(VARIABLE, "").split(os.pathsep)
    return {Path(place).resolve() for place in places if place}
