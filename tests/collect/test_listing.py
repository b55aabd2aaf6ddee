"""The best occurrences of every view become videos, and the others have a reason."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

import imocap
from imocap_core.cli import main
from imocap_core.collect.listing import CollectedList, Occurrence, SameTakeAs, decide, occurrence_of
from imocap_core.collect.matching import Match
from imocap_core.collect.shots import Shot
from imocap_core.params import CollectParams
from imocap_core.pipeline.action import read_action
from tests.collect.made_tracks import movement, track

PARAMS = CollectParams(keep=3)
GOOD = Occurrence(
    film=0, shot=0, track=0, first=0, stop=60, rate=1.0, score=0.8, mirrored=False,
    mirror_margin=0.0, azimuth_deg=0.0, height_px=300.0, visible=1.0, confidence=0.9,
    box_px=(0, 0, 100, 280), box_frame=30, alone=True,
)  # fmt: skip


def reasons(occurrences: list[Occurrence], again: dict[int, SameTakeAs] | None = None) -> list[str]:
    names = [f"s{k}" for k in range(len(occurrences))]
    fps = [30.0] * len(names)
    return [d.reason for d in decide(occurrences, again or {}, names, fps, PARAMS)]


def test_every_view_has_its_best_before_one_has_two() -> None:
    front = [replace(GOOD, score=score) for score in (0.9, 0.8, 0.7)]
    side = [replace(GOOD, azimuth_deg=90.0, score=0.5), replace(GOOD, azimuth_deg=270.0, score=0.5)]
    assert reasons([*front, *side]) == [
        "",
        "less visible than others of that view (s0)",
        "less visible than others of that view (s0)",
        "",
        "",
    ]


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ({"height_px": 40.0}, "too small: 40 px"),
        ({"stop": 9}, "too short: 0.3 s"),
        ({"visible": 0.5}, "the person is detected in 50% of it only"),
    ],
)
def test_what_cannot_be_captured_is_no_video(fault: dict[str, float], reason: str) -> None:
    assert reasons([GOOD, replace(GOOD, **fault)]) == ["", reason]


def test_a_take_is_taken_once() -> None:
    again = {1: SameTakeAs(0, 0.25), 2: SameTakeAs(0, 1.02)}
    assert reasons([GOOD, GOOD, GOOD], again) == [
        "",
        "replay of s0 at 0.25 times its speed",
        "duplicate of s0",
    ]


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, 200.0, 300.0])
def test_views_are_told_apart_in_a_mirror_too(azimuth_deg: float, mirrored: bool) -> None:
    straight = track(movement(1), noise_m=0.0)
    turned = track(movement(1), azimuth_deg=azimuth_deg, mirrored=mirrored, noise_m=0.0)
    shot = Shot(0, 1000, "cut", "cut")
    match = Match(0, 15, 75, 1.0, 0.9, False)
    before = occurrence_of(match, straight, shot, 0.0, alone=True)
    after = occurrence_of(replace(match, mirrored=mirrored), turned, shot, 0.0, alone=True)
    change = (after.azimuth_deg - before.azimuth_deg) % 360
    assert min(abs(change - azimuth_deg), abs(change - 360 + azimuth_deg)) < 1.0


def test_a_margin_stays_within_the_shot() -> None:
    there = track(movement(1), first=100)
    shot = Shot(100, 100 + len(there.joints), "cut", "cut")
    occurrence = occurrence_of(Match(0, 2, 80, 1.0, 0.9, False), there, shot, 0.2, alone=True)
    assert (occurrence.first, occurrence.stop) == (100, 186)


Film = tuple[Path, Path]
EXAMPLE = (0.2, 1.8)  # s


def run(*words: object) -> int:
    return main([*map(str, words)])


@pytest.fixture(scope="session")
def collected(film: Film) -> imocap.CollectedAction:
    root, file = film
    few = {"collect.least_height_px": 20}
    return imocap.collect("squat", [file], example=(file, *EXAMPLE), root=root, params=few)


def test_every_shot_is_listed_with_what_became_of_it(collected: imocap.CollectedAction) -> None:
    (film,) = collected.listing.films
    assert [shot.frames for shot in film.shots] == [
        (0, 60), (60, 100), (100, 160), (160, 400), (400, 420),
    ]  # fmt: skip
    assert film.frame_count == 432
    outcomes = [shot.outcome for shot in film.shots]
    assert outcomes[0] == "s001: a video"
    assert outcomes[1].startswith("nothing like the action")
    assert outcomes[2] == "s003: a video"
    assert re.fullmatch(r"s004: replay of s001 at 0\.2\d times its speed", outcomes[3])
    assert outcomes[4] == "still picture"


def test_the_occurrences_are_videos_of_the_action(collected: imocap.CollectedAction) -> None:
    action = read_action(collected.action_file.parent)
    assert [video.id for video in action.videos] == ["s001", "s003"]
    assert [(action.folder / str(v.video)).resolve().name for v in action.videos] == [
        "long film.mp4"
    ] * 2
    first, second = (video.frames for video in action.videos)
    assert 0 <= first[0] < 15
    assert 45 < first[1] <= 60
    assert 100 <= second[0] < second[1] <= 160
    text = collected.action_file.read_text(encoding="utf-8")
    assert "# long film.mp4, shot 3, 0:03." in text


def test_an_occurrence_is_compared_with_the_others_too(collected: imocap.CollectedAction) -> None:
    score = {o.id: o.score for o in collected.listing.occurrences}
    assert 0.6 < score["s001"] < 0.97  # the example itself, 1 by itself
    assert score["s003"] > 0.6


def test_the_list_is_read_back(collected: imocap.CollectedAction) -> None:
    text = collected.list_file.read_text(encoding="utf-8")
    assert CollectedList.model_validate_json(text) == collected.listing


def test_the_movement_that_is_repeated_is_found_without_an_example(film: Film) -> None:
    root, file = film
    done = imocap.collect(
        "any", [file], root=root, dry_run=True, params={"collect.least_height_px": 20}
    )
    assert {occurrence.shot for occurrence in done.listing.occurrences} >= {1, 3}
    assert not (root / "actions" / "any").exists()


def test_the_command_prints_the_shots_and_what_is_next(film, capsys):
    root, file = film
    words = ["--like", file, "--from", EXAMPLE[0], "--to", EXAMPLE[1], "--root", root]
    assert run("collect", "again", file, *words, "--set", "collect.least_height_px=20") == 0
    out = capsys.readouterr().out
    assert "s001: a video" in out
    assert "Next: imocap run again" in out
    assert run("collect", "again", file, *words) == 2
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--like", "FILM"], "--like, --from and --to: expected all three"),
        (["--like", "FILM", "--from", "2", "--to", "1"], "expected from before to"),
        (["--like", "FILM", "--from", "1", "--to", "99"], "which is 14.40 s long"),
        (["--like", "FILM", "--from", "14.1", "--to", "14.3"], "a part of one shot"),
        (["--like", "FOLDER", "--from", "1", "--to", "1.5"], "expected the video of the example"),
        (["--like", "FILM", "--from", "1", "--to", "3"], "shots begin at 0.00, 2.00"),
        (["--like", "nothing.mp4", "--from", "1", "--to", "3"], "there is no video nothing.mp4"),
    ],
)
def test_a_wrong_example_is_one_sentence(film, capsys, words, sentence):
    root, file = film
    places = {"FILM": str(file), "FOLDER": str(file.parent)}
    given = [places.get(word, word) for word in words]
    assert run("collect", "wrong", file, *given, "--root", root) == 2
    message = capsys.readouterr().err
    assert sentence in message
    assert message.count("\n") == 1


def test_a_folder_of_films_is_taken_and_what_is_no_video_is_named(film: Film) -> None:
    root, file = film
    folder = root / "films"
    folder.mkdir()
    (folder / "film.mp4").write_bytes(file.read_bytes())
    (folder / "notes.txt").write_text("no video")
    few = {"collect.least_height_px": 20}
    done = imocap.collect("all", [folder], example=(file, *EXAMPLE), root=root, params=few)
    assert [Path(f.video).name for f in done.listing.films] == ["film.mp4"]
    assert any("notes.txt" in remark for remark in done.remarks)
    with pytest.raises(imocap.WrongUse, match="notes"):
        imocap.collect("text", [folder / "notes.txt"], root=root)
