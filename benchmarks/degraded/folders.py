"""Action folders of degraded footage: the source's videos, people to be detected, its truth.

A folder appears complete or not at all, and is made again when its code or the action has changed.
"""

from __future__ import annotations

from pathlib import Path
from shutil import copyfile

import yaml

from benchmarks.actions.action_folder import action_key, make_whole
from benchmarks.actions.real import copy_file, detected_declaration, source_files
from benchmarks.degraded.footage import Footage, degraded_pictures
from benchmarks.detector.reference import reference_limbs
from benchmarks.stability.perturbations import Declared
from benchmarks.stability.variants import CRF, TRUTHS
from imocap_core.io.video import probe, read_rgb, write_h264
from imocap_core.pipeline.action import FILE_NAME
from imocap_core.pipeline.source import closure
from imocap_core.pipeline.yaml_file import load_yaml


def footage_key(source: Path, footage: Footage) -> str:
    """Digest of all that an action of degraded footage is made of."""
    return action_key([closure(Path(__file__)), footage.name], source_files(source))


def make_footage(folder: Path, source: Path, footage: Footage) -> None:
    """Write the action of degraded footage into `folder` unless it was made already."""
    key = footage_key(source, footage)
    make_whole(folder, key, lambda new: _write(new, folder.name, source, footage))


def _write(folder: Path, name: str, source: Path, footage: Footage) -> None:
    action = load_yaml(source / FILE_NAME)
    for number, declared in enumerate(action["videos"]):
        if footage.degrades(number):
            _write_video(folder, source, declared, footage, number)
        else:
            copy_file(source, folder, declared["video"])
    videos = [detected_declaration(declared) for declared in action["videos"]]
    action |= {"name": name, "videos": videos}
    for file in source.glob(TRUTHS):
        copyfile(file, folder / file.name)
    (folder / FILE_NAME).write_text(yaml.safe_dump(action, sort_keys=False))


def _write_video(
    folder: Path, source: Path, declared: Declared, footage: Footage, number: int
) -> None:
    file = source / declared["video"]
    info = probe(file)
    limbs = reference_limbs(source, declared["id"], info.frame_count)
    pictures = degraded_pictures((picture for _, picture in read_rgb(file)), limbs, footage, number)
    (folder / declared["video"]).parent.mkdir(parents=True, exist_ok=True)
    write_h264(folder / declared["video"], pictures, info.fps, crf=CRF)
