"""An action made of the occurrences of a movement in long videos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from imocap_core.errors import WrongUse
from imocap_core.library.door import plain_errors
from imocap_core.library.one_off import Params, one_off
from imocap_core.library.progress import Progress, displaying
from imocap_core.library.video_files import video_files
from imocap_core.pipeline.action import FILE_NAME, check_name
from imocap_core.pipeline.repeated_files import repeated_paths
from imocap_core.workspace import Workspace

if TYPE_CHECKING:
    from imocap_core.collect.listing import CollectedList


@dataclass(frozen=True)
class CollectedAction:
    """What `collect` made: the list of all shots and occurrences, and the files.

    action_file and list_file are None where nothing was to be written. remarks: on the files.
    """

    listing: CollectedList
    action_file: Path | None
    list_file: Path | None
    remarks: tuple[str, ...] = ()


@plain_errors
def collect(
    name: str,
    videos: Sequence[str | Path],
    *,
    example: tuple[str | Path, float, float] | None = None,
    keep: int | None = None,
    dry_run: bool = False,
    root: str | Path = ".",
    params: Params = None,
    progress: Progress = None,
) -> CollectedAction:
    """Make root/actions/NAME of the occurrences of one movement in long videos.

    Args:
        videos: films of many shots, or folders of them, in which what is no video is left out.
        example: a video that shows the movement, and from and to in seconds; else the movement
            that is repeated most.
        keep: most occurrences that become videos; else `collect.keep`.
        dry_run: only say what would be taken.
        params: one-off parameters, as {"collect.least_contrast": 1.5}.

    Raises:
        WrongUse: the name is invalid or taken, a video is missing, the example is not in its video.
        WorkFailed: a video cannot be decoded, or nothing is found.
    """
    from imocap_core.collect.collect import collect_films
    from imocap_core.collect.listing import FILE_NAME as LIST_NAME
    from imocap_core.collect.listing import write_collected
    from imocap_core.collect.movement import Example
    from imocap_core.collect.writing import write_action
    from imocap_core.pipeline.graph import settings

    check_name(name)
    files, remarks = video_files([Path(video) for video in videos])
    source = None if example is None else Example(Path(example[0]), example[1], example[2])
    if source is not None and video_files([source.video])[0] != [source.video]:
        raise WrongUse(f"{source.video}: expected the video of the example, got a folder")
    remarks = [*remarks, *repeated_paths(files)]
    workspace = Workspace(Path(root))
    folder = workspace.root / "actions" / name
    if (folder / FILE_NAME).exists() and not dry_run:
        raise WrongUse(f"{folder / FILE_NAME} exists already; edit it, or choose another name")
    pipeline = workspace.pipeline()
    sets = [*one_off(params), *([f"collect.keep={keep}"] if keep is not None else [])]
    chosen = settings(pipeline, {}, pipeline.file, sets).params
    with displaying(progress) as display:
        listing, alone = collect_films(workspace, name, files, source, chosen, folder, display)
    if dry_run or not listing.chosen:
        return CollectedAction(listing, None, None, tuple(remarks))
    folder.mkdir(parents=True, exist_ok=True)
    write_collected(folder / LIST_NAME, listing)
    action_file = write_action(folder, listing, alone)
    return CollectedAction(listing, action_file, folder / LIST_NAME, tuple(remarks))
