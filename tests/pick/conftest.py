"""An action of short films with a walking figure and a bystander, and its keypoints."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from imocap_core.io.video import write_h264
from imocap_core.pick.server import picking
from tests.made_keypoints import write_openpose
from tests.pick.made import Asker

FRAMES, SIZE, FPS = 40, (320, 180), 20.0
CUT = 24  # the first frame of another shot of v1


def figure(x: float, high: float) -> np.ndarray:
    """(25, 3) BODY_25 points of somebody upright."""
    rows = np.linspace(0, 1, 5)
    points = np.stack([[x + high * 0.15 * side, 20 + high * row] for row in rows
                       for side in (-1, -0.5, 0, 0.5, 1)])  # fmt: skip
    return np.concatenate([points, np.full((25, 1), 0.9)], axis=1)


def people_in(t: int) -> list[np.ndarray]:
    return [figure(60 + 3 * t, 130), figure(280, 60)]


def picture(t: int, shade: int, other_shot: bool) -> np.ndarray:
    base = np.indices((SIZE[1], SIZE[0])).sum(axis=0) if not other_shot else (
        np.indices((SIZE[1], SIZE[0]))[1] // 20 % 2 * 120
    )  # fmt: skip
    shown = np.repeat(((base + shade) % 200).astype(np.uint8)[..., None], 3, axis=2)
    for person, colour in zip(people_in(t), ((240, 200, 60), (60, 120, 240)), strict=True):
        (x0, y0), (x1, y1) = person[:, :2].min(axis=0), person[:, :2].max(axis=0)
        shown[int(y0) : int(y1), max(0, int(x0)) : int(x1)] = colour
    return shown


@pytest.fixture(scope="session")
def films(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("films")
    for n, name in enumerate(("v1", "v2")):
        cut = CUT if name == "v1" else FRAMES
        frames = [picture(t, 40 * n, t >= cut) for t in range(FRAMES)]
        write_h264(folder / f"{name}.mp4", frames, FPS)
        write_openpose(folder / name, map(people_in, range(FRAMES)))
    return folder


def working_folder(folder: Path, films: Path) -> Path:
    """A working folder with the action `made`."""
    action = folder / "actions" / "made"
    action.mkdir(parents=True)
    for name in ("v1", "v2"):
        (action / f"{name}.mp4").write_bytes((films / f"{name}.mp4").read_bytes())
        (action / name).symlink_to(films / name)
    fields = "format: openpose, layout: body25"
    (action / "action.yaml").write_text(
        "# made for a test\nname: made\nvideos:\n"
        f"  - {{id: v1, video: v1.mp4, keypoints: v1, {fields}}}   # first\n"
        f"  - {{id: v2, video: v2.mp4, keypoints: v2, {fields}}}\n"
    )
    return folder


@pytest.fixture
def root(tmp_path: Path, films: Path) -> Path:
    """A working folder with the action `made`."""
    return working_folder(tmp_path, films)


@pytest.fixture
def asker(root: Path) -> Iterator[Asker]:
    """A client of the action's page."""
    with picking("made", [], root) as served:
        yield Asker(served, root / "actions" / "made" / "action.yaml")
