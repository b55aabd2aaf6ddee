"""Who does what is done in the other videos too."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from imocap_core.conventions import SMPL_JOINTS
from imocap_core.people.performer import (
    FramePlace,
    SeenMotion,
    choose_by_agreement,
    declared_performer,
    pose_set_distances_m,
    ranked_tracks,
    rivals,
    row_at_place,
    row_of_number,
)


def motion(seed: int, frames: int = 50) -> np.ndarray:
    """(T, 24, 3): a pose that goes through a cycle of its own."""
    rng = np.random.default_rng(seed)
    rest, first, second = rng.normal(0, 0.3, (3, 24, 3))
    phase = np.linspace(0, 2 * np.pi, frames)[:, None, None]
    return rest + 0.5 * np.cos(phase) * first + 0.5 * np.sin(phase) * second


def seen(joints: np.ndarray) -> SeenMotion:
    """A motion all of whose joints are seen."""
    return SeenMotion(joints, np.ones(joints.shape[:2]))


def view_of(seed: int, view: int, frames: int = 50, noise: float = 0.01) -> SeenMotion:
    """The same from another side, with noise."""
    rng = np.random.default_rng([seed, view])
    turn = Rotation.random(random_state=view).as_matrix()
    return seen(motion(seed, frames) @ turn.T + rng.normal(0, noise, (frames, 24, 3)))


def test_a_larger_stranger_is_not_the_performer() -> None:
    """One video shows somebody with a larger score who does something else."""
    scores = [[1.0, 0.6], [1.0], [1.0]]
    poses = [[view_of(8, 0), view_of(1, 1)], [view_of(1, 2, 41)], [view_of(1, 3, 63)]]
    assert choose_by_agreement(scores, poses) == [1, 0, 0]


def test_somebody_who_stands_by_in_every_video_does_not_perform() -> None:
    """Nearer to each other than the performers are, because nothing moves."""
    rng = np.random.default_rng(3)
    still = motion(9)[:1] + rng.normal(0, 0.01, (3, 50, 24, 3))
    offsets = rng.normal(0, 0.02, (3, 24, 3))
    poses = [[seen(still[v]), seen(view_of(1, v).joints_m + offsets[v])] for v in range(3)]
    standing, performing = (pose_set_distances_m(poses[0][k], poses[1][k])[0] for k in (0, 1))
    assert standing < 0.8 * performing
    assert choose_by_agreement([[1.0, 0.9]] * 3, poses) == [1, 1, 1]


def test_the_larger_of_two_who_do_the_same_performs() -> None:
    poses = [[view_of(1, 0), view_of(1, 1)], [view_of(1, 2)]]
    assert choose_by_agreement([[1.0, 0.6], [1.0]], poses) == [0, 0]


def test_what_a_detector_guesses_of_hidden_limbs_does_not_count() -> None:
    """The performer's legs are hidden in a third of each video, and guessed otherwise each time; a
    bystander in full view moves a little, alike in all."""
    legs = [k for k, name in enumerate(SMPL_JOINTS) if "knee" in name or "ankle" in name]
    poses = []
    for v, first in enumerate((0, 15, 30)):
        performer = view_of(1, v, noise=0.05)
        hidden = np.ix_(range(first, first + 20), legs)
        performer.joints_m[hidden] += np.random.default_rng(v).normal(0, 0.4, (20, len(legs), 3))
        performer.visibility[hidden] = 0.02
        poses.append([performer, view_of(2, v, noise=0.05)])
    blind = [[seen(performer.joints_m), other] for performer, other in poses]
    assert choose_by_agreement([[1.0, 0.8]] * 3, blind) == [1, 1, 1]
    assert choose_by_agreement([[1.0, 0.8]] * 3, poses) == [0, 0, 0]


def test_all_ways_and_one_at_a_time_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    scores = [[1.0, 0.8], [1.0, 0.9], [1.0], [1.0, 0.5]]
    poses = [[view_of(7, 0), view_of(1, 1)], [view_of(1, 2), view_of(6, 3)], [view_of(1, 4)],
             [view_of(5, 5), view_of(1, 6)]]  # fmt: skip
    every = choose_by_agreement(scores, poses)
    monkeypatch.setattr("imocap_core.people.performer.MAX_COMBINATIONS", 1)
    assert every == choose_by_agreement(scores, poses) == [1, 0, 0, 1]


def test_one_video_alone_takes_the_score() -> None:
    assert choose_by_agreement([[1.0, 0.9]], [[view_of(1, 0), view_of(2, 0)]]) == [0]


def test_distance_of_sets_is_symmetric_and_blind_to_sides_and_order() -> None:
    a, b = view_of(1, 0), view_of(2, 1)
    assert pose_set_distances_m(a, b) == pytest.approx(pose_set_distances_m(b, a))
    turned = seen(a.joints_m[::-1] @ Rotation.random(random_state=3).as_matrix().T)
    assert pose_set_distances_m(turned, b) == pytest.approx(pose_set_distances_m(a, b), rel=1e-6)
    assert pose_set_distances_m(a, a)[0] < 1e-6
    moving, still = pose_set_distances_m(a, b)
    assert moving < still
    alone = (seen(motion.joints_m[:1]) for motion in (a, b))
    assert len(set(pose_set_distances_m(*alone))) == 1  # a pose alone is still


def test_only_those_near_the_best_are_thought_of() -> None:
    assert rivals([1.0, 0.5, 0.41, 0.3]) == [0, 1, 2]


SHAPE = np.random.default_rng(0).uniform(-1, 1, (17, 2)) * [25, 60]


def person(x: float, wave: float = 0.0) -> np.ndarray:
    pose = np.concatenate([[x, 180] + SHAPE, np.full((17, 1), 0.8)], axis=1)
    pose[:4, 1] += wave
    return pose


PEOPLE = [np.stack([person(150, 20 * np.sin(0.3 * t)), person(450)]) for t in range(60)]
RANKED = ranked_tracks(PEOPLE, (640, 360), 30.0, min_confidence=0.05)


def x_of(row: int) -> float:
    return float(np.nanmean(declared_performer(RANKED, row, PEOPLE).xy_px[:, 5:, 0]))


def test_by_number() -> None:
    assert x_of(row_of_number(RANKED, 1)) == pytest.approx(150, abs=20)
    assert x_of(row_of_number(RANKED, 2)) == pytest.approx(450, abs=20)
    with pytest.raises(ValueError, match="track: expected 1 to 2, got 3"):
        row_of_number(RANKED, 3)


@pytest.mark.parametrize(
    "place",
    [
        FramePlace(10, point_px=(640, 20)),
        FramePlace(10, box_px=(0, 0, 20, 20)),
        FramePlace(99, (150, 180)),
    ],
)
def test_an_error_lists_who_is_in_the_frame(place: FramePlace) -> None:
    with pytest.raises(ValueError, match=r"got nobody; in that frame there are: (track 1 at|none)"):
        row_at_place(RANKED, place)


def test_the_note_names_the_declaration() -> None:
    assert "as action.yaml declares" in declared_performer(RANKED, 1, PEOPLE).note
