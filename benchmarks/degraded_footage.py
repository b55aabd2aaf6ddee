"""Degraded footage of an action: which videos are degraded, how, and their pictures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shutil import copyfile
from typing import Literal

import numpy as np
import yaml
from jaxtyping import Float

from benchmarks.actions.action_folder import action_key, make_whole
from benchmarks.actions.prepare import copy_file, detected_declaration, source_files
from benchmarks.detector import (
    DEGRADATIONS,
    MIDDLE_THIRD,
    PLAIN,
    Degradation,
    Picture,
    hidden_legs,
    reference_limbs,
)
from benchmarks.stability_variants import CRF, TRUTHS, Declared
from imocap_core.io.video import probe, read_rgb, write_h264
from imocap_core.pipeline.action import FILE_NAME
from imocap_core.pipeline.source import closure
from imocap_core.pipeline.yaml_file import load_yaml

Extent = Literal["none", "one", "all"]
SEED = 1
KINDS = ("legs", "blur", "second", "dropped")
ONE = 1  # the video that is degraded alone: the second
THIRDS = (MIDDLE_THIRD, 0.0, 2 / 3, 1 / 2)  # where legs are hidden in all: share of the clip
IMPOSSIBLE = (("second", "all"),)  # the mirrored performers fit each other as well


@dataclass(frozen=True)
class Footage:
    """An action's videos with none, one or all of them degraded."""

    degradation: Degradation
    extent: Extent

    @property
    def name(self) -> str:
        """A name for files."""
        return f"{self.degradation.name}-{self.extent}" if self.extent != "none" else PLAIN.name

    def degrades(self, video: int) -> bool:
        """Whether it degrades a video, by its number in the action."""
        return self.extent == "all" or (self.extent == "one" and video == ONE)

    def legs_hidden_from(self, video: int) -> float:
        """The share of the clip at which a third with hidden legs begins: in all videos another
        third in each, as nobody would see the legs there otherwise."""
        return THIRDS[video % len(THIRDS)] if self.extent == "all" else MIDDLE_THIRD


def degraded_pictures(
    pictures: Iterable[Picture], limbs: Float[np.ndarray, "T 12 2"], footage: Footage, video: int
) -> Iterator[Picture]:
    """As many pictures, so that frame numbers stay: a dropped one shows the last one again.

    Args:
        limbs: the performer's, in pixels; where some are NaN the picture stays as it is.
        video: its number in the action; other pictures of each are dropped.
    """
    degradation = footage.degradation
    change = degradation.picture
    if change is hidden_legs:
        change = partial(hidden_legs, begin=footage.legs_hidden_from(video))
    rng, shown = np.random.default_rng([SEED, video]), None
    for number, picture in enumerate(pictures):
        if shown is None or rng.random() >= degradation.dropped:
            shown = picture
        if change is not None and np.isfinite(limbs[number]).all():
            yield change(shown, limbs[number], number / len(limbs))
        else:
            yield shown


def _footages() -> Iterator[Footage]:
    yield Footage(PLAIN, "none")
    by_name = {degradation.name: degradation for degradation in DEGRADATIONS}
    extents: tuple[Extent, ...] = ("one", "all")
    for kind in KINDS:
        for extent in extents:
            if (kind, extent) not in IMPOSSIBLE:
                yield Footage(by_name[kind], extent)


FOOTAGES = tuple(_footages())  # the first is as filmed


# Action folders of degraded footage: the source's videos, people to be detected, its truth.
#
# A folder appears complete or not at all, and is made again when its code or the action has
# changed.


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
