"""The benchmark of stability: perturbations change what they say and nothing else; its verdicts."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from benchmarks import stability, stability_variants
from benchmarks.parallel import in_process, other_thread_count
from imocap_core.artifacts.schemas import Camera, Keypoints, SyncMap, SyncSummary, VideoKeypoints
from imocap_core.errors import WrongUse
from imocap_core.io.readers.json_people import read_openpose
from imocap_core.io.truth import Truth, VideoTruth, read_truth
from imocap_core.io.video import probe, write_h264

FRAMES, SIZE = 6, (64, 48)
PERTURBATIONS = {p.name: p for p in stability_variants.OF_FILES}
PICTURES = {p.name: p for p in stability_variants.OF_PIXELS}


def points(rng: np.random.Generator, people: int = 1) -> np.ndarray:
    """COCO's 18 points with confidences; one of each person is missing."""
    made = np.concatenate(
        [rng.uniform(5, 40, (people, 18, 2)), rng.uniform(0.2, 1, (people, 18, 1))], axis=-1
    )
    made[:, 3] = 0.0
    return made


@pytest.fixture
def action(tmp_path: Path) -> Path:
    """An action of two videos: v1 has pictures, v2 declares its frame rate, size and frames."""
    rng, folder = np.random.default_rng(0), tmp_path / "tiny"
    truth: dict[str, Any] = {"joint_names": np.array(["pelvis"]), "phase_end": 10.0}
    for number, video in enumerate(("v1", "v2")):
        (folder / "keypoints" / video).mkdir(parents=True)
        for frame in range(FRAMES):
            people = [{"pose_keypoints_2d": p.ravel().tolist()} for p in points(rng, 2)]
            file = folder / "keypoints" / video / f"{video}_{frame:012d}_keypoints.json"
            file.write_text(json.dumps({"version": 1.3, "people": people}))
        truth[f"{video}/joints"] = rng.normal(size=(FRAMES, 1, 3))
        truth[f"{video}/phase"] = np.arange(FRAMES) + 0.5 * number
    np.savez(folder / "truth.npz", **truth)
    (folder / "videos").mkdir()
    still = rng.integers(0, 256, (SIZE[1], SIZE[0], 3)).astype(np.uint8)
    write_h264(folder / "videos" / "v1.mp4", [still] * FRAMES, 30.0)
    form = {"format": "openpose", "layout": "coco18"}
    v1 = {"id": "v1", "video": "videos/v1.mp4", "keypoints": "keypoints/v1", **form}
    v2 = {"id": "v2", "keypoints": "keypoints/v2", **form, "fps": 30.0, "size": [200, 400]}
    declared = {"name": "tiny", "videos": [v1, {**v2, "frames": [1, 5]}], "truth": "truth.npz"}
    (folder / "action.yaml").write_text(yaml.safe_dump(declared))
    return folder


def variant(
    source: Path, perturbation: stability_variants.Perturbation, *, detected: bool = False
) -> Path:
    folder = source.parent / f"tiny-{perturbation.name}"
    stability_variants.make_variant(folder, source, perturbation, detected)
    return folder


def declared_videos(folder: Path) -> list[dict[str, Any]]:
    return list(yaml.safe_load((folder / "action.yaml").read_text())["videos"])


def detections(folder: Path, video: str) -> np.ndarray:
    return np.stack(read_openpose(folder / "keypoints" / video, "coco18").people)


def test_a_shift_is_exact_and_leaves_missing_points_alone() -> None:
    before = points(np.random.default_rng(1), 3)
    after = stability_variants.shifted_points(before, 100.0, np.random.default_rng(0))
    moved = before[..., 2] > 0
    np.testing.assert_array_equal(after[moved], before[moved] + [1.0, 1.0, 0.0])
    np.testing.assert_array_equal(after[~moved], before[~moved])


def test_noise_is_one_per_cent_of_the_person_and_seeded() -> None:
    before = np.tile(points(np.random.default_rng(1)), (2000, 1, 1))
    once, again = (
        stability_variants.noisy_points(before, 300.0, np.random.default_rng(5)) for _ in range(2)
    )
    np.testing.assert_array_equal(once, again)
    moved = before[..., 2] > 0
    offset = (once - before)[moved]
    assert offset[:, :2].std() == pytest.approx(3.0, rel=0.05)
    assert np.abs(offset[:, :2].mean(axis=0)).max() < 0.1
    np.testing.assert_array_equal(offset[:, 2], 0.0)
    np.testing.assert_array_equal(once[~moved], before[~moved])


def test_the_size_of_a_person_is_that_of_the_largest_without_missing_points() -> None:
    small = np.array([[10.0, 10, 1], [14, 20, 1], [500, 500, 0]])
    large = np.array([[10.0, 10, 1], [40, 20, 1], [10, 10, 0]])
    assert stability_variants.person_size_px([small, large]) == 30.0
    assert np.isnan(stability_variants.person_size_px([]))


def test_grey_levels_move_by_one_and_stay_in_range() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (20, 30, 3)).astype(np.uint8)
    after = stability_variants.grey_level_picture(picture, np.random.default_rng(1)).astype(int)
    difference = after - picture
    assert set(np.unique(difference)) == {-1, 0, 1}  # 0 where black or white is at its end
    np.testing.assert_array_equal(np.abs(difference)[(picture > 0) & (picture < 255)], 1)


def test_a_shifted_picture_has_every_pixel_one_further() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (20, 30, 3)).astype(np.uint8)
    after = stability_variants.shifted_picture(picture, np.random.default_rng(1))
    assert after.shape == picture.shape
    np.testing.assert_array_equal(after[1:, 1:], picture[:-1, :-1])


def test_jpeg_keeps_the_order_of_colours() -> None:
    picture = np.zeros((16, 16, 3), np.uint8)
    picture[..., 0] = 200
    after = stability_variants.recompressed_picture(picture, np.random.default_rng(0)).astype(int)
    assert np.abs(after - picture).max() <= 8


def test_the_undisturbed_variant_is_the_action(action: Path) -> None:
    folder = variant(action, PERTURBATIONS["undisturbed"])
    for file in (f for f in action.rglob("*") if f.is_file() and f.name != "action.yaml"):
        assert (folder / file.relative_to(action)).read_bytes() == file.read_bytes()
    assert declared_videos(folder) == declared_videos(action)


def test_dropping_a_frame_keeps_phases(action: Path) -> None:
    for name, part in (("first_frame", slice(1, None)), ("last_frame", slice(None, -1))):
        folder = variant(action, PERTURBATIONS[name])
        before, after = (
            read_truth(
                place / "truth.npz",
                {
                    v["id"]: np.arange(*stability_variants.frame_range(place, v))
                    for v in declared_videos(place)
                },
            )
            for place in (action, folder)
        )
        for video in ("v1", "v2"):
            phase, full = after.videos[video].phase, before.videos[video].phase
            np.testing.assert_array_equal(phase, full[part])


def test_reversing_the_order_twice_is_the_identity(action: Path) -> None:
    once = variant(action, PERTURBATIONS["order"])
    assert [v["id"] for v in declared_videos(once)] == ["v2", "v1"]
    twice = once.parent / "twice"
    stability_variants.make_variant(twice, once, PERTURBATIONS["order"], False)
    assert declared_videos(twice) == declared_videos(action)


def test_keypoints_grow_with_the_pictures(action: Path) -> None:
    folder = variant(action, PERTURBATIONS["scale"])
    size = declared_videos(folder)[1]["size"]
    assert size == [201, 402]
    info = probe(folder / "videos" / "v1.mp4")
    assert info.frame_count == FRAMES
    for video, grown in (("v1", np.divide(info.size, SIZE)), ("v2", [1.005, 1.005])):
        before, after = (detections(place, video)[..., :2] for place in (action, folder))
        np.testing.assert_allclose(after, before * grown)


def test_pixel_variants_name_no_keypoints_and_are_coded_again(action: Path) -> None:
    folder = variant(action, PICTURES["grey"], detected=True)
    assert not (folder / "keypoints").exists()
    assert all(v["keypoints"] == "detect" and "layout" not in v for v in declared_videos(folder))
    assert probe(folder / "videos" / "v1.mp4") == probe(action / "videos" / "v1.mp4")


def test_a_variant_is_made_once_and_again_when_the_action_changes(action: Path) -> None:
    folder = variant(action, PERTURBATIONS["noise"])
    made = folder.stat().st_ino
    variant(action, PERTURBATIONS["noise"])
    assert folder.stat().st_ino == made
    (action / "keypoints" / "v2" / f"v2_{0:012d}_keypoints.json").write_text('{"people": []}')
    variant(action, PERTURBATIONS["noise"])
    assert detections(folder, "v1").shape == detections(action, "v1").shape
    assert folder.stat().st_ino != made


def result(
    mm: float, camera: float = 2.0, frames: float = 0.5, **more: Any
) -> stability.VariantScore:
    metrics = ("mpjpe_mm", "camera_pair_error_deg", "sync_pair_error_frames")
    return stability.VariantScore(
        "p", dict(zip(metrics, (mm, camera, frames), strict=True)), "v1", **more
    )


def test_the_worst_is_held_against_the_median() -> None:
    moved = stability.movement([result(50.0), result(40.0, camera=3.5), result(60.0, frames=0.4)])
    assert (moved.undisturbed_mm, moved.median_mm, moved.worst_mm) == (50.0, 50.0, 60.0)
    assert moved.worst_pct == pytest.approx(20.0)
    assert moved.camera_deg == pytest.approx(1.5)
    assert moved.sync_frames == pytest.approx(0.1)
    assert moved.broken_limits == ["MPJPE", "cameras"]


def test_failed_and_unscored_runs_are_not_stable() -> None:
    failed = stability.VariantScore("p", {}, fault="stage sync failed")
    assert stability.movement([result(50.0), result(50.0), failed]).broken_limits == [
        "a run failed"
    ]
    unscored = stability.VariantScore("p", {"mpjpe_mm": 50.0, "sync_pair_error_frames": 0.5})
    assert stability.movement([result(50.0), unscored]).broken_limits == ["cameras"]


def test_other_excluded_videos_are_counted() -> None:
    scores = [result(50.0), result(50.0, excluded=("v2",)), result(50.0, mirrored=("v3",))]
    assert stability.movement(scores).screening_differs == 2


def test_every_action_begins_undisturbed_and_meets_each_perturbation_once() -> None:
    for name in stability.ACTIONS:
        names = [p.name for p in stability.perturbations_of(name)]
        assert names[0] == "undisturbed"
        assert len(set(names)) == len(names)
    assert stability.chosen_actions(("yoga",)) == ["yoga"]
    with pytest.raises(WrongUse, match="--only nothing"):
        stability.chosen_actions(("nothing",))


def test_a_process_of_its_own_has_the_other_number_of_threads() -> None:
    threads = other_thread_count()
    before = os.environ.get("OMP_NUM_THREADS")
    assert str(threads) != before
    assert in_process(os.getenv, ("OMP_NUM_THREADS",), threads) == str(threads)
    assert os.environ.get("OMP_NUM_THREADS") == before


OFFSETS = {"v1": 0.0, "v2": 3.0, "v3": -2.0}  # the phase of each video's first frame
PAIR_FRAMES = 40


def truth(turns: dict[str, Rotation] | None = None) -> Truth:
    videos = {
        name: VideoTruth(
            joints=None,
            joint_names=(),
            phase=np.arange(PAIR_FRAMES) + offset,
            K=None,
            R=None if turns is None else turns[name].as_matrix(),
            t=None,
        )
        for name, offset in OFFSETS.items()
    }
    return Truth(videos=videos, phase_end=float(PAIR_FRAMES))


def keypoints() -> Keypoints:
    return Keypoints.model_construct(
        videos=[
            VideoKeypoints.model_construct(id=name, frames=np.arange(PAIR_FRAMES))
            for name in OFFSETS
        ]
    )


def sync(reference: str, errors: dict[str, float]) -> SyncSummary:
    """True maps but for a constant error of each video's place on the common axis."""
    frames = np.arange(float(PAIR_FRAMES))
    shift = {name: OFFSETS[name] + errors[name] for name in OFFSETS}
    maps = [
        SyncMap(
            id=i, reference_frame=frames + s - shift[reference], confidence=np.ones(PAIR_FRAMES)
        )
        for i, s in shift.items()
    ]
    return SyncSummary.model_construct(
        reference=reference, ids=list(OFFSETS), lengths=[PAIR_FRAMES] * 3, maps=maps,
        excluded=[], mirrored=[],
    )  # fmt: skip


def cameras(turns: dict[str, Rotation]) -> list[Camera]:
    return [Camera.model_construct(id=name, R=turn.as_matrix()) for name, turn in turns.items()]


def random_turns(seed: int) -> dict[str, Rotation]:
    rng = np.random.default_rng(seed)
    return {name: Rotation.random(random_state=rng) for name in OFFSETS}


@pytest.mark.parametrize("reference", list(OFFSETS))
def test_sync_errors_of_pairs_do_not_depend_on_the_reference(reference: str) -> None:
    errors = {"v1": 0.0, "v2": 0.4, "v3": -0.2}
    pairs = stability.sync_pair_errors_frames(
        list(OFFSETS), sync(reference, errors), keypoints(), truth()
    )
    assert sorted(pairs) == pytest.approx([0.2, 0.2, 0.4, 0.4, 0.6, 0.6])
    exact = sync(reference, dict.fromkeys(OFFSETS, 0.0))
    assert stability.sync_pair_errors_frames(
        list(OFFSETS), exact, keypoints(), truth()
    ) == pytest.approx([0.0] * 6)


def test_camera_errors_of_pairs_do_not_depend_on_the_world() -> None:
    true = random_turns(1)
    world = Rotation.random(random_state=np.random.default_rng(2))
    wrong = {**true, "v2": Rotation.from_rotvec([0.0, 0.0, 0.1]) * true["v2"]}
    turned = {name: turn * world for name, turn in wrong.items()}
    expected = np.degrees([0.1, 0.0, 0.1])  # of v1 and v2, v1 and v3, v2 and v3
    for estimate in (wrong, turned):
        pairs = stability.camera_pair_errors_deg(cameras(estimate), truth(true))
        np.testing.assert_allclose(pairs, expected, atol=1e-6)
