"""`imocap video`: which films are written, what they hold, and what is said when they can't be."""

from pathlib import Path

import numpy as np
import pytest

from imocap_core.cli import main
from imocap_core.errors import WorkFailed
from imocap_core.film import films_of, write_films
from imocap_core.io.video import probe
from imocap_core.library.result import Result
from imocap_core.pipeline.runner import Job
from imocap_core.workspace import Workspace
from tests.pipeline.stored import NAME, stored_job
from tests.report.made import SIZE, Made


@pytest.fixture(scope="module")
def made() -> Made:
    return Made(frames=12)


def result_of(job: Job) -> Result:
    return Result.of_action(job.store, job.action)


def test_films_are_written_whether_or_not_there_are_videos(made: Made, tmp_path: Path) -> None:
    job = stored_job(tmp_path, made, filmed=("v1",))
    films = films_of(result_of(job), "both", mesh=False, motion="final", opacity=0.7)
    names = ["overlay_v1.mp4", "overlay_v2.mp4", "overlay_v3.mp4", "side_by_side.mp4"]
    assert [film.name for film in films] == names
    steps: list[tuple[str, int]] = []
    files = write_films(films, tmp_path / "out", lambda film, done: steps.append((film.name, done)))
    assert [file.name for file in files] == names
    for film, file in zip(films, files, strict=True):
        info = probe(file)
        assert info.frame_count == film.count
        assert info.fps == pytest.approx(film.fps)
        assert [done for name, done in steps if name == film.name] == list(range(1, film.count + 1))
        if film.name.startswith("overlay"):
            assert info.size == SIZE
        data = file.read_bytes()
        assert data.find(b"moov") < data.find(b"mdat")  # plays while it loads


def test_one_kind_alone_and_the_monocular_result(made: Made, tmp_path: Path) -> None:
    job = stored_job(tmp_path, made)
    alone = films_of(result_of(job), "side-by-side", mesh=False, motion="final", opacity=0.7)
    assert [film.name for film in alone] == ["side_by_side.mp4"]
    bodies = films_of(result_of(job), "side-by-side", mesh=True, motion="final", opacity=0.7)
    with_body, without = next(bodies[0].frames()), next(alone[0].frames())
    assert (with_body != without).any(axis=2).mean() > 0.01
    assert np.ptp(without[60:-80].astype(int)) > 150  # keypoints on the neutral ground
    overlays = films_of(result_of(job), "overlay", mesh=True, motion="monocular", opacity=1.0)
    final = films_of(result_of(job), "overlay", mesh=True, motion="final", opacity=1.0)
    assert len(overlays) == 3
    first, last = next(overlays[0].frames()), next(final[0].frames())
    assert (first != last).any()


def test_a_part_is_a_film_of_all_videos(made: Made, tmp_path: Path) -> None:
    how = {"mesh": False, "motion": "final", "opacity": 0.7}
    result = result_of(stored_job(tmp_path, made))
    (film,) = films_of(result, "both", span_s=(0.1, 0.3), **how)
    assert (film.name, film.count) == ("loop_0.10-0.30s.mp4", 7)
    (whole,) = films_of(result, "side-by-side", **how)
    for part, same in zip(film.frames(), list(whole.frames())[3:], strict=False):
        assert (part[50:-80] == same[50:-80]).all()
    with pytest.raises(ValueError, match=r"span within 0\.00 to 0\.\d+ s, got 5\.00 to 6\.00"):
        films_of(result, "both", span_s=(5.0, 6.0), **how)


def test_an_artifact_of_another_version_is_named_in_one_line(made: Made, tmp_path: Path) -> None:
    job = stored_job(tmp_path, made)
    other = job.store.load(NAME, "keypoints")
    job.store.publish(NAME, "camera_motion", other)
    with pytest.raises(WorkFailed, match=r"another camera_motion .*imocap run waving$") as said:
        films_of(result_of(job), "both", mesh=True, motion="final", opacity=0.7)
    assert "\n" not in str(said.value)


def test_a_broken_video_is_named(made: Made, tmp_path: Path) -> None:
    stored_job(tmp_path, made, filmed=("v1",))
    (tmp_path / "actions" / NAME / "v1.mp4").write_bytes(b"no video")
    job = Workspace(tmp_path).job(NAME, [])
    films = films_of(result_of(job), "overlay", mesh=True, motion="final", opacity=0.7)
    with pytest.raises(WorkFailed, match=r"v1\.mp4: is not a readable video"):
        write_films(films, tmp_path / "out", lambda film, done: None)


def test_the_commands_say_where_things_are_or_what_is_wrong(made, tmp_path, capsys):
    job = stored_job(tmp_path, made)
    out = tmp_path / "films"
    words = ["video", NAME, "--root", str(tmp_path), "--kind", "side-by-side", "--out", str(out)]
    assert main(words) == 0
    assert str(out / "side_by_side.mp4") in capsys.readouterr().out
    assert main(["report", NAME, "--root", str(tmp_path)]) == 0
    assert "report.html" in capsys.readouterr().out
    assert main([*words, "--opacity", "2"]) == 2
    capsys.readouterr()
    job.store.current(NAME, "sync").unlink()
    assert main(["report", NAME, "--root", str(tmp_path)]) == 1
    assert (
        "(smpl_ba: input: sync is gone). Bring them up to date: imocap run waving"
        in capsys.readouterr().err
    )
