"""Anchors, forbidden spans and mirrored of action.yaml: read, checked, part of sync's key."""

from pathlib import Path

import numpy as np
import pytest

from imocap_core.adapters.hints import event_sound, hints_of, with_one_offset, with_sound
from imocap_core.artifacts.schemas import Keypoints, SyncMap
from imocap_core.errors import WorkFailed
from imocap_core.io.video import read_sound
from imocap_core.pipeline.action import Action, AnchorEntry, ForbiddenEntry, read_action
from imocap_core.pipeline.graph import read_pipeline, settings
from imocap_core.pipeline.keys import recipe
from imocap_core.sync import Anchor, Hints
from tests.adapters.test_synchronisation import made
from tests.io.made_sound import RATE, event, loop, recorded, write_film
from tests.made_sync import trust_in
from tests.report.made import Made

HEAD = """\
name: serve
videos:
  - {id: v1, keypoints: a, format: openpose, layout: body25, fps: 30, size: [64, 48]}
  - {id: v2, keypoints: a, format: openpose, layout: body25, fps: 30, size: [64, 48],
     mirrored: true}
  - {id: v3, keypoints: a, format: openpose, layout: body25, fps: 30, size: [64, 48]}
"""


def action(folder: Path, more: str) -> Action:
    (folder / "a").mkdir(exist_ok=True)
    (folder / "action.yaml").write_text(HEAD + more)
    return read_action(folder)


def test_hints_are_read(tmp_path: Path) -> None:
    found = action(
        tmp_path,
        "anchors: [{v1: 120, v2: 88, hard: true}, {v1: 130, v2: 90, v3: 95}]\n"
        "forbidden: [{video: v1, frames: [0, 40]}]\n",
    )
    assert [a.frames for a in found.anchors] == [
        {"v1": 120, "v2": 88},
        {"v1": 130, "v2": 90, "v3": 95},
    ]
    assert [a.hard for a in found.anchors] == [True, False]
    assert found.forbidden[0].frames == (0, 40)
    assert [v.mirrored for v in found.videos] == [None, True, None]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("anchors: [{v1: 1, v9: 2}]", "anchors.0: unknown video 'v9'; expected one of v1, v2, v3"),
        ("anchors: [{v1: 1}]", "expected frames of at least two videos"),
        ("anchors: [{v1: 1, v2: -4}]", "anchors.0.v2: expected greater than or equal to 0"),
        ("anchors: [{v1: 1, v2: 2.5}]", "anchors.0.v2: expected a valid integer"),
        ("anchors: [{v1: 10, v2: 20}, {v1: 30, v2: 5}]", "anchors.0 and anchors.1 contradict"),
        (
            "anchors: [{v1: 10, v2: 20}, {v1: 10, v2: 21}]",
            "contradict the order of time: v1 10 = v2 20, but",
        ),
        ("forbidden: [{video: v9, frames: [0, 4]}]", "forbidden.0: unknown video 'v9'"),
        (
            "forbidden: [{video: v1, frames: [4, 4]}]",
            "frames: expected [first, one past last], got [4, 4]",
        ),
        (
            "anchors: [{v1: 3, v2: 4}]\nforbidden: [{video: v1, frames: [0, 9]}]",
            "anchors.0: frame 3 of v1 is in the forbidden span [0, 9]",
        ),
    ],
)
def test_what_cannot_be_is_named(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(WorkFailed) as caught:
        action(tmp_path, text)
    assert said in str(caught.value)


def videos() -> Keypoints:
    _, keypoints = made(["v1", "v2"], [0.0, 0.4])
    late = keypoints.videos[1].model_copy(update={"frames": np.arange(100, 160)})
    return Keypoints(videos=[keypoints.videos[0], late])


def test_source_frames_become_used_frames_but_of_a_video_that_was_left_out() -> None:
    hints = hints_of(
        [AnchorEntry(v1=20, v2=110, hard=True, bad=7), AnchorEntry(v1=30, bad=8)],
        [ForbiddenEntry(video="v2", frames=(90, 105)), ForbiddenEntry(video="bad", frames=(0, 5))],
        videos(),
        "action.yaml",
    )
    assert hints.anchors == (Anchor(0, 20, 1, 10.0, True),)
    assert hints.forbidden == ((1, 0, 5),)


def test_frames_that_are_not_used_are_named() -> None:
    with pytest.raises(ValueError, match=r"action\.yaml: anchors\.0") as caught:
        hints_of(
            [AnchorEntry(v1=20, v2=10)],
            [ForbiddenEntry(video="v1", frames=(200, 300))],
            videos(),
            "action.yaml",
        )
    said = str(caught.value)
    assert "expected a used frame of v2, 100 to 159, got 10" in said
    assert "forbidden.0: expected frames of v1 within 0 to 59, got [200, 300]" in said


def test_hints_change_the_key_of_sync_and_of_nothing_before_it(tmp_path: Path) -> None:
    pipeline = read_pipeline(Path(__file__).parents[2] / "pipeline.yaml")
    chosen = settings(pipeline, {}, tmp_path, [])
    plain, anchored = (
        action(tmp_path, more) for more in ("", "anchors: [{v1: 1, v2: 2, hard: true}]")
    )
    for stage, same in (("keypoints", True), ("initial_smpl", True), ("sync", False)):
        inputs = dict.fromkeys(pipeline.stages[stage].inputs, "x")
        one, two = (recipe(pipeline, stage, a, chosen, inputs).key for a in (plain, anchored))
        assert (one == two) is same


FRAMES = 40


def test_matches_become_lines_and_phases_follow() -> None:
    made = Made(3, frames=FRAMES)
    position = np.arange(FRAMES) + 5.0
    wobbling = position + 0.4 * np.sin(np.arange(FRAMES))
    wobbling[30:] += 12.0
    maps = [
        SyncMap(id=i, reference_frame=r, confidence=np.ones(FRAMES))
        for i, r in (("v1", np.arange(FRAMES, dtype=float)), ("v2", wobbling), ("v3", position))
    ]
    trust = trust_in({i: np.arange(FRAMES) / 30 for i in ("v1", "v2", "v3")})
    given = made.sync.model_copy(
        update={"reference": "v1", "maps": maps, "trust": trust, "excluded": ["v3"]}
    )
    sync = with_one_offset(given, made.keypoints, None)
    line = sync.maps[1].reference_frame
    inside = np.isfinite(line)
    np.testing.assert_allclose(np.diff(line[inside])[:-1], 1.0)
    np.testing.assert_allclose(line[0], 5.0, atol=0.2)
    assert np.isnan(line[np.arange(FRAMES) + 5 > FRAMES]).all()
    np.testing.assert_allclose(sync.maps[1].confidence[inside], 30 / 40)
    assert sync.maps[2] is maps[2]  # excluded
    fps = made.keypoints.videos[0].fps
    np.testing.assert_allclose(sync.trust.videos[1].phase_s[0], 5.0 / fps, atol=0.2 / fps)
    np.testing.assert_allclose(np.diff(sync.trust.videos[1].phase_s), 1 / fps)


def test_sound_counts_from_the_beginning_of_the_files() -> None:
    made = Made(2, frames=FRAMES)
    used = made.keypoints.videos[1]
    shifted = used.model_copy(update={"frames": used.frames + 6})
    later = made.keypoints.model_copy(update={"videos": [made.keypoints.videos[0], shifted]})
    sync = with_one_offset(made.sync, later, np.array([0.0, 0.5]))
    begun = sync.ids.index(sync.reference)
    other = 1 - begun
    at_zero = np.interp(0.0, np.arange(FRAMES), sync.maps[other].reference_frame)
    first_s = [video.time_s[0] for video in later.videos]
    expected = (first_s[1] + 0.5 - first_s[0]) * used.fps
    np.testing.assert_allclose(at_zero, expected if other == 1 else -expected, atol=0.01)


STARTS = (0.0, 1.37, 0.52)
SECONDS, FPS = 6.0, 30.0


@pytest.fixture(scope="module")
def keypoints():
    """Three videos of 180 frames."""
    return Keypoints(
        videos=[v.model_copy(update={"fps": FPS}) for v in Made(3, frames=180).keypoints.videos]
    )


def films(folder, sound, starts=STARTS):
    bands = ((80.0, 8000.0), (300.0, 3400.0), (200.0, 6000.0))
    return {
        f"v{k + 1}": write_film(
            folder / f"v{k + 1}.mp4",
            recorded(sound, start, SECONDS, band_hz=bands[k], gain=0.3**k, noise=0.5, seed=k),
            SECONDS,
        )
        for k, start in enumerate(starts)
    }


def test_films_of_one_event_are_placed_within_a_frame(tmp_path, keypoints):
    heard = event_sound(films(tmp_path, event(9.0)), keypoints)
    np.testing.assert_allclose(heard.start_s, STARTS, atol=0.5 / FPS)
    assert heard.notes == ["by their sound, against the beginning of v1: v2 +1.37 s, v3 +0.52 s"]
    hints = with_sound(Hints(), heard.start_s, keypoints)
    assert len(hints.anchors) > 40
    for tie in hints.anchors:
        late = STARTS[tie.b] - STARTS[tie.a]
        a, b = (keypoints.videos[v].time_s for v in (tie.a, tie.b))
        time_b = np.interp(tie.frame_b, np.arange(len(b)), b)
        assert a[tie.frame_a] - time_b == pytest.approx(late, abs=0.5 / FPS)
        assert not tie.hard


@pytest.mark.long
def test_music_that_repeats_is_said_and_not_used(tmp_path, keypoints):
    heard = event_sound(films(tmp_path, loop(9.0)), keypoints)
    assert np.isnan(heard.start_s).all()
    assert len(heard.notes) == 3
    assert all("their sound repeats itself" in note for note in heard.notes)
    assert with_sound(Hints(), heard.start_s, keypoints) == Hints()


@pytest.mark.long
def test_a_silent_film_takes_no_part(tmp_path, keypoints):
    files = films(tmp_path, event(9.0))
    files["v3"] = write_film(tmp_path / "silent.mp4", None, SECONDS)
    heard = event_sound(files, keypoints)
    np.testing.assert_allclose(heard.start_s[:2], STARTS[:2], atol=0.5 / FPS)
    assert np.isnan(heard.start_s[2])
    assert any(note.startswith("v3: no sound") for note in heard.notes)
    assert np.isnan(event_sound({}, keypoints).start_s).all()


def test_anchors_of_the_user_come_first(keypoints):
    user = Anchor(0, 60, 1, 20.0, True)
    hints = with_sound(Hints((user,), ((2, 0, 100),)), np.array(STARTS), keypoints)
    assert [x for x in hints.anchors if {x.a, x.b} == {0, 1}] == [user]
    assert all(x.frame_b > 99.5 for x in hints.anchors if x.b == 2)


def test_sound_is_read_from_the_first_picture_on(tmp_path):
    clicks = np.zeros(2 * RATE)
    clicks[RATE] = 1.0
    samples = read_sound(write_film(tmp_path / "a.mp4", clicks, 2.0), 16_000.0)
    assert abs(np.abs(samples).argmax() / 16_000.0 - 1.0) < 0.005
    assert read_sound(write_film(tmp_path / "b.mp4", None, 1.0), 16_000.0) is None
