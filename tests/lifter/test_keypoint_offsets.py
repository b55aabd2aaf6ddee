"""Laws of the correction of marks."""

import numpy as np
import pytest

from imocap_core.body.layouts import layout_names
from imocap_core.conventions import mirror_indices, sideless
from imocap_core.lifter.keypoint_offsets import (
    FEATURES,
    FLIP,
    POINTS,
    TRUNK,
    ShiftNetwork,
    corrected_marks,
    load_correction,
    read_weights,
    write_weights,
)

NAMES = layout_names("blazepose33")
MOVED = [NAMES.index(f"{side}_{end}") for side in ("left", "right") for end in TRUNK]
STANDING = {
    "nose": (0, -75), "shoulder": (19, -50), "elbow": (24, -25), "wrist": (27, 0),
    "hip": (11, 0), "knee": (12, 40), "ankle": (13, 80),
}  # fmt: skip


def standing(frames: int = 6) -> np.ndarray:
    """Somebody seen from the front, swaying a little; (T, 33, 2) pixels."""
    rng = np.random.default_rng(3)
    xy = rng.normal(0.0, 1.0, (frames, len(NAMES), 2))
    for column, name in enumerate(NAMES):
        x, y = STANDING.get(sideless(name), (0, -70))
        xy[:, column] += (-x if name.startswith("right") else x, y)
    return xy + (320.0, 240.0)


def network(seed: int) -> ShiftNetwork:
    """Any network."""
    rng = np.random.default_rng(seed)
    sizes = ((8, FEATURES), (8, 8), (2, 8))
    return ShiftNetwork(
        rng.normal(size=FEATURES),
        rng.uniform(0.5, 2.0, FEATURES),
        tuple(0.3 * rng.normal(size=size) for size in sizes),
        tuple(0.3 * rng.normal(size=size[0]) for size in sizes),
    )


CORRECTION = {"shoulder": network(1), "hip": network(2)}


def test_only_shoulders_and_hips_move() -> None:
    xy = standing()
    moved = np.linalg.norm(corrected_marks(xy, NAMES, CORRECTION) - xy, axis=-1)
    assert (moved[:, MOVED] > 0).all()
    assert (np.delete(moved, MOVED, axis=1) == 0).all()


def test_a_larger_person_elsewhere_is_corrected_likewise() -> None:
    xy = standing()
    larger = 2.5 * xy + (700.0, -30.0)
    expected = 2.5 * corrected_marks(xy, NAMES, CORRECTION) + (700.0, -30.0)
    np.testing.assert_allclose(corrected_marks(larger, NAMES, CORRECTION), expected)


def test_the_mirrored_picture_has_the_mirrored_correction() -> None:
    xy, twins = standing(), list(mirror_indices(NAMES))
    expected = corrected_marks(xy, NAMES, CORRECTION)[:, twins] * FLIP
    corrected = corrected_marks(xy[:, twins] * FLIP, NAMES, CORRECTION)
    np.testing.assert_allclose(corrected, expected)


def test_missing_points_count_as_between_their_neighbours_and_stay_missing() -> None:
    xy = standing()
    elbow, hip = NAMES.index("left_elbow"), NAMES.index("right_hip")
    xy[2, elbow] = (xy[1, elbow] + xy[3, elbow]) / 2
    complete = corrected_marks(xy, NAMES, CORRECTION)
    xy[2, elbow] = np.nan
    xy[4, hip] = np.nan
    corrected = corrected_marks(xy, NAMES, CORRECTION)
    np.testing.assert_array_equal(np.isnan(corrected), np.isnan(xy))
    np.testing.assert_allclose(corrected[2, MOVED], complete[2, MOVED])


def test_points_that_are_never_detected_leave_all_as_they_are() -> None:
    xy = standing()
    xy[:, NAMES.index("left_ankle")] = np.nan
    np.testing.assert_array_equal(corrected_marks(xy, NAMES, CORRECTION), xy)
    columns = [k for k, name in enumerate(NAMES) if name != "nose"]
    names = [NAMES[k] for k in columns]
    assert not set(POINTS) <= set(names)
    xy = standing()[:, columns]
    np.testing.assert_array_equal(corrected_marks(xy, names, CORRECTION), xy)


def test_shipped_shifts_are_a_few_percent_of_the_person() -> None:
    correction = load_correction("blazepose33")
    xy = standing()
    moved = np.linalg.norm(corrected_marks(xy, NAMES, correction) - xy, axis=-1)[:, MOVED]
    assert 0.05 < moved.mean() < 8.0  # of 160 pixels


def test_other_layouts_have_no_correction() -> None:
    assert load_correction("body25b") is None


def test_weights_are_read_as_written(tmp_path) -> None:
    write_weights(tmp_path / "some.safetensors", CORRECTION)
    content = (tmp_path / "some.safetensors").read_bytes()
    read = read_weights(content, "some.safetensors")
    expected = corrected_marks(standing(), NAMES, CORRECTION)
    np.testing.assert_allclose(corrected_marks(standing(), NAMES, read), expected, atol=1e-3)
    with pytest.raises(ValueError, match=r"some\.safetensors: expected a mark correction"):
        read_weights(content[:-9], "some.safetensors")
