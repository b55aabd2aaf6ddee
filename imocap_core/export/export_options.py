"""What of a result is exported, where its origin is, and as what character."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from imocap_core.errors import WrongUse
from imocap_core.io.writers.rigs import RIGS

Origin = Literal["ground", "start"]
LAFAN1 = "lafan1"
CHARACTERS = ("bvh", "glb", "fbx", "usd")


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export beside format, axes and timeline.

    videos: those to export; all where empty. mean: the mean of the performances instead, as one
    clip on the common timeline. origin: ground: under the mean place of the bodies; start: under
    the first body's first pose, which faces forward. names: of the joints, with the rest pose of
    that rig: smpl, mixamo, ue5, rigify or, in bvh, lafan1. root_bone: a bone on the floor carries
    the motion. lock_feet: feet in contact with the ground stay where they stand.
    variation: the mean and both ends of each mode of variation, two standard deviations away, as
    clips on the common timeline, with the distribution as numbers.
    """

    videos: tuple[str, ...] = ()
    mean: bool = False
    origin: str = "ground"
    names: str = "smpl"
    root_bone: bool = False
    lock_feet: bool = False
    variation: bool = False

    @property
    def levelled(self) -> bool:
        """Whether it takes a world that stands on its ground."""
        return self.origin == "start"

    def check(self, format: str) -> None:
        """WrongUse for values that are none, and for what a format cannot hold."""
        for option, given, allowed in (
            ("--origin", self.origin, get_args(Origin)),
            ("--names", self.names, ("smpl", *RIGS, LAFAN1)),
        ):
            if given not in allowed:
                raise WrongUse(f"{option}: expected one of {', '.join(allowed)}, got {given}")
        if format not in CHARACTERS and (self.names != "smpl" or self.root_bone):
            raise WrongUse(
                f"--names and --root-bone are of characters, in {', '.join(CHARACTERS)}; {format} "
                f"has none"
            )
        if self.names == LAFAN1 and (format != "bvh" or self.root_bone):
            raise WrongUse("--names lafan1 is of bvh, without --root-bone")
        if self.variation and (self.mean or self.videos):
            raise WrongUse("--variation is of all performances; leave --mean and --video out")
        if self.mean and self.videos:
            raise WrongUse("--mean is of all performances; leave --video out")
