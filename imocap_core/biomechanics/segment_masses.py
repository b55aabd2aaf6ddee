"""Mass and inertia of the linkage's segments, for a body of known shape.

The total comes from the volume of the surface; the shares are de Leva's (`body.mass`), the inertia
is that of a homogeneous ellipsoid as large as the segment's vertices reach. Good for pictures and
first estimates; a study of forces wants measured numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from imocap_core.biomechanics.linkage import Link
from imocap_core.body.mass import LIMB_SEGMENTS, MIDDLE_SEGMENTS
from imocap_core.conventions import SIDES

DENSITY_KG_M3 = 1000.0  # of a whole body, about that of water
JOINTS_OF = {  # whose vertices make up a segment
    "pelvis": ("pelvis", "spine1"),
    "thorax": ("spine2", "spine3", "collar"),
    "head": ("neck", "head"),
    "thigh": ("hip",),
    "shank": ("knee",),
    "foot": ("ankle", "foot"),
    "humerus": ("shoulder",),
    "forearm": ("elbow",),
    "hand": ("wrist", "hand"),
}
SHARE_FROM = {  # the proximal joint of de Leva's segment
    "thigh": "hip",
    "shank": "knee",
    "foot": "ankle",
    "humerus": "shoulder",
    "forearm": "elbow",
    "hand": "wrist",
}


@dataclass(frozen=True, eq=False)
class SegmentMass:
    """mass_kg; centre_m and radii_m of the ellipsoid in the segment's axes; inertia_kg_m2 about
    these through the centre."""

    mass_kg: float
    centre_m: Float[np.ndarray, "3"]
    radii_m: Float[np.ndarray, "3"]

    @property
    def inertia_kg_m2(self) -> Float[np.ndarray, "3"]:
        """Principal moments of a solid ellipsoid."""
        squares = self.radii_m**2
        return np.asarray(self.mass_kg / 5 * (squares.sum() - squares))


def segment_masses(
    links: Mapping[str, Link],
    vertices_m: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    owners: list[str],
) -> dict[str, SegmentMass]:
    """Mass and shape of every segment.

    Args:
        vertices_m: of the rest pose. owners: per vertex the joint that moves it most.
    """
    total = DENSITY_KG_M3 * volume_m3(vertices_m, faces)
    shares = _shares()
    masses = {}
    for name, link in links.items():
        prefix, segment = _parted(name)
        joints = {j for base in JOINTS_OF[segment] for j in (base, prefix + base)}
        if not prefix:
            joints |= {f"{side}_{base}" for side in SIDES for base in JOINTS_OF[segment]}
        points = link.local_m(vertices_m[np.isin(owners, sorted(joints))])
        low, high = points.min(axis=0), points.max(axis=0)
        masses[name] = SegmentMass(total * shares[segment], (low + high) / 2, (high - low) / 2)
    return masses


def volume_m3(vertices_m: Float[np.ndarray, "V 3"], faces: Int[np.ndarray, "F 3"]) -> float:
    """Volume inside a closed surface: the sum of the signed tetrahedra from its triangles."""
    a, b, c = (vertices_m[faces[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6)


def _shares() -> dict[str, float]:
    """Each segment's share of the body's mass; the trunk's lower third is the pelvis'."""
    by_start = {start: share for start, _, share, _ in (*MIDDLE_SEGMENTS, *LIMB_SEGMENTS)}
    shares = {segment: by_start[start] for segment, start in SHARE_FROM.items()}
    thorax = by_start["spine1"] + by_start["spine3"]
    return shares | {"head": by_start["neck"], "thorax": thorax, "pelvis": by_start["pelvis"]}


def _parted(name: str) -> tuple[str, str]:
    """A link's side, as a prefix, and its segment."""
    side, _, segment = name.partition("_")
    return (f"{side}_", segment) if side in SIDES else ("", name)
