"""Small files of 2D keypoints in every format's true form, from frame -> people (K, 3)."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from imocap_core.body.layouts import layout_names

SIZE = (640, 360)
People = dict[int, list[np.ndarray]]


def people(layout: str, frames: int = 3, persons: int = 2) -> People:
    """Whole pixels and hundredths, which every format keeps; one point was not found."""
    rng = np.random.default_rng(0)
    count = len(layout_names(layout))
    made = {}
    for frame in range(frames):
        made[frame] = []
        for _ in range(persons):
            xy = rng.integers(10, 350, size=(count, 2)).astype(float)
            person = np.column_stack([xy, rng.integers(20, 99, size=count) / 100])
            person[5] = (np.nan, np.nan, 0.0)
            made[frame].append(person)
    return made


def _flat(person: np.ndarray) -> list[float]:
    return np.nan_to_num(person).ravel().tolist()


def write_openpose(folder: Path, made: People, hands: bool = False) -> Path:
    path = folder / "frames"
    path.mkdir()
    for frame, in_frame in made.items():
        entries: list[dict[str, Any]] = [{"pose_keypoints_2d": _flat(p)} for p in in_frame]
        if hands:
            for entry in entries:
                entry |= {f"hand_{side}_keypoints_2d": [1.0] * 63 for side in ("left", "right")}
                entry |= {"person_id": [-1], "face_keypoints_2d": [2.0] * 210}
        name = f"clip_{frame:012d}_keypoints.json"
        (path / name).write_text(json.dumps({"version": 1.3, "people": entries}))
    return path


def write_alphapose(folder: Path, made: People) -> Path:
    entries = [
        {"image_id": f"{frame}.jpg", "category_id": 1, "keypoints": _flat(person), "score": 2.5,
         "box": [1.0, 2.0, 3.0, 4.0], "idx": [0.0]}
        for frame, in_frame in made.items() for person in in_frame
    ]  # fmt: skip
    return _json(folder / "alphapose-results.json", entries)


def write_coco(folder: Path, made: People) -> Path:
    entries = [
        {"image_id": frame, "category_id": 1, "keypoints": _flat(person), "score": 0.9}
        for frame, in_frame in made.items() for person in in_frame
    ]  # fmt: skip
    return _json(folder / "results.json", entries)


def write_coco_wholebody(folder: Path, made: People) -> Path:
    names = ("keypoints", "foot_kpts", "face_kpts", "lefthand_kpts", "righthand_kpts")
    ends = np.cumsum([0, 17, 6, 68, 21, 21])
    entries = [
        {"image_id": frame, "category_id": 1, "score": 0.9}
        | {n: _flat(person[a:b]) for n, a, b in zip(names, ends[:-1], ends[1:], strict=True)}
        for frame, in_frame in made.items() for person in in_frame
    ]  # fmt: skip
    return _json(folder / "wholebody.json", entries)


def write_mmpose(folder: Path, made: People) -> Path:
    listed = _mmpose_frames(made, first=1)
    content = {"meta_info": {"dataset_name": "coco"}, "instance_info": listed}
    return _json(folder / "results_clip.json", content)


def write_mmpose_inferencer(folder: Path, made: People) -> Path:
    return _json(folder / "clip.json", _mmpose_frames(made, first=0))


def _mmpose_frames(made: People, first: int) -> list[dict[str, Any]]:
    return [
        {"frame_id": frame + first, "instances": [_instance(person) for person in in_frame]}
        for frame, in_frame in made.items()
    ]


def _instance(person: np.ndarray) -> dict[str, Any]:
    xy = np.nan_to_num(person[:, :2]).tolist()
    scores = person[:, 2].tolist()
    return {"keypoints": xy, "keypoint_scores": scores, "bbox": [[1, 2, 3, 4]], "bbox_score": 0.9}


def write_npz(folder: Path, made: People) -> Path:
    table = np.array(list(made.values()))
    path = folder / "rtmlib.npz"
    np.savez(path, keypoints=table[..., :2], scores=table[..., 2], frames=np.array(list(made)))
    return path


def write_mediapipe(folder: Path, made: People, shares: bool = True) -> Path:
    listed = []
    for frame, in_frame in made.items():
        persons = [
            [
                {"x": x / (SIZE[0] if shares else 1), "y": y / (SIZE[1] if shares else 1),
                 "z": 0.1, "visibility": v, "presence": 0.9}
                for x, y, v in np.nan_to_num(person)
            ]
            for person in in_frame
        ]  # fmt: skip
        world = [[{"x": 0.1 * k, "y": 0.2, "z": 0.3} for k in range(33)] for _ in in_frame]
        listed.append({"frame": frame, "pose_landmarks": persons, "pose_world_landmarks": world})
    return _json(folder / "mediapipe.json", listed)


def write_cpn_npz(folder: Path, made: People) -> Path:
    """One camera of one action: one person, no confidence."""
    table = np.array([in_frame[0][:, :2] for in_frame in made.values()], dtype=np.float32)
    return write_positions(folder, {"S9": {"Walking 1": [table]}}, "h36m")


def write_positions(folder: Path, positions: Any, layout_name: str) -> Path:
    path = folder / "data_2d_h36m_cpn_ft_h36m_dbb.npz"
    metadata = {"layout_name": layout_name, "num_joints": 17, "keypoints_symmetry": [[4], [1]]}
    np.savez(
        path,
        positions_2d=np.array(positions, dtype=object),
        metadata=np.array(metadata, dtype=object),
    )
    return path


def _json(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path


def _alphapose_frames(made: People, bodies: bool) -> dict[str, Any]:
    name, field = ("bodies", "joints") if bodies else ("people", "pose_keypoints_2d")
    return {
        f"{frame:06d}.jpg": {"version": "AlphaPose v0.3", name: [{field: _flat(p)} for p in people]}
        for frame, people in made.items()
    }


def write_alphapose_cmu(folder: Path, made: People) -> Path:
    return _json(folder / "alphapose-results.json", _alphapose_frames(made, bodies=True))


def write_alphapose_open(folder: Path, made: People) -> Path:
    return _json(folder / "alphapose-results.json", _alphapose_frames(made, bodies=False))


def write_alphapose_folder(folder: Path, made: People) -> Path:
    contents = _alphapose_frames(made, bodies=True).items()
    return _folder(folder / "sep-json", {name[:-4]: content for name, content in contents})


def write_mmpose_raw(folder: Path, made: People) -> Path:
    return _json(folder / "predictions.json", [[*map(_instance, ps)] for ps in made.values()])


def write_mmpose_nested(folder: Path, made: People) -> Path:
    """`predictions` of each of the inferencer's results: a list of one picture's people."""
    return _json(folder / "predictions.json", [[[*map(_instance, ps)]] for ps in made.values()])


def write_mmpose_results(folder: Path, made: People) -> Path:
    results = [
        {"visualization": [], "predictions": [[*map(_instance, people)]]}
        for people in made.values()
    ]
    return _json(folder / "results.json", results)


def write_dwpose(folder: Path, made: People) -> Path:
    """As ComfyUI's nodes save it: one list, a frame's parts null where they were not detected."""
    listed = [
        {
            "people": [
                {"pose_keypoints_2d": _flat(p), "face_keypoints_2d": None}
                | {f"hand_{side}_keypoints_2d": None for side in ("left", "right")}
                for p in people
            ],
            "canvas_height": 360, "canvas_width": 640,
        }
        for people in made.values()
    ]  # fmt: skip
    return _json(folder / "dwpose.json", listed)


def write_landmark_lists(folder: Path, made: People) -> Path:
    listed = [
        [dict(zip(("x", "y", "z", "visibility"), row, strict=True)) for row in rows]
        for rows in (np.nan_to_num(_shares(people[0])).tolist() for people in made.values())
    ]
    return _json(folder / "landmarks.json", listed)


def write_numbered_csv(folder: Path, made: People) -> Path:
    count = len(made[0][0])
    heading = ["frame", *(f"{axis}{k}" for k in range(count) for axis in "xyc")]
    rows = [[frame, *np.nan_to_num(people[0]).ravel()] for frame, people in made.items()]
    return _csv(folder / "points.csv", [heading, *rows])


def write_named_csv(folder: Path, made: People) -> Path:
    heading = [f"{name}_{axis}" for name in layout_names("coco17") for axis in ("x", "y", "conf")]
    rows = [np.nan_to_num(people[0]).ravel() for people in made.values()]
    return _csv(folder / "points.csv", [heading, *rows])


def write_mmpose_folder(folder: Path, made: People) -> Path:
    contents = {f"{frame:06d}": [*map(_instance, ps)] for frame, ps in made.items()}
    return _folder(folder / "predictions", contents)


def write_easymocap(folder: Path, made: People) -> Path:
    contents = {
        f"{frame:06d}": {
            "filename": f"images/1/{frame:06d}.jpg", "height": 360, "width": 640,
            "annots": [
                {"bbox": [1, 2, 3, 4, 0.9], "personID": n, "keypoints": np.nan_to_num(p).tolist()}
                for n, p in enumerate(people)
            ],
        }
        for frame, people in made.items()
    }  # fmt: skip
    return _folder(folder / "annots", contents)


def _yolo_frames(made: People) -> list[list[dict[str, Any]]]:
    axes = ("x", "y", "visible")
    return [
        [
            {"name": "person", "class": 0, "confidence": 0.9, "box": {"x1": 1.0, "y1": 2.0},
             "keypoints": dict(zip(axes, np.nan_to_num(p).T.tolist(), strict=True))}
            for p in people
        ]
        for people in made.values()
    ]  # fmt: skip


def write_ultralytics(folder: Path, made: People) -> Path:
    return _json(folder / "yolo.json", _yolo_frames(made))


def write_ultralytics_texts(folder: Path, made: People) -> Path:
    return _json(folder / "yolo.json", [json.dumps(frame) for frame in _yolo_frames(made)])


def write_ultralytics_labels(folder: Path, made: People) -> Path:
    path = folder / "labels"
    path.mkdir()
    for frame, people in made.items():
        rows = [[0, 0.5, 0.5, 0.1, 0.2, *_flat(p), 7] for p in people]
        text = "\n".join(" ".join(map(str, row)) for row in rows)
        (path / f"my clip_{frame + 1}.txt").write_text(text + "\n")
    return path


def write_npy(folder: Path, made: People) -> Path:
    np.save(folder / "points.npy", np.array(list(made.values())))
    return folder / "points.npy"


def write_mediapipe_csv(folder: Path, made: People) -> Path:
    heading = ["frame", *(f"{axis}{k + 1}" for k in range(33) for axis in "xyzv")]
    rows = [[frame, *_shares(people[0]).ravel()] for frame, people in made.items()]
    return _csv(folder / "pose.csv", [heading, *rows])


def write_mediapipe_named_csv(folder: Path, made: People) -> Path:
    names = layout_names("mediapipe33")
    heading = [f"{name.upper()}_{axis}" for name in names for axis in ("x", "y", "z", "visibility")]
    return _csv(
        folder / "pose.csv", [heading, *(_shares(people[0]).ravel() for people in made.values())]
    )


def write_mediapipe_semicolons(folder: Path, made: People) -> Path:
    """As a spreadsheet saves it where the decimal point is a comma."""
    path = write_mediapipe_csv(folder, made)
    text = path.read_text().replace(",", ";").replace(".", ",")
    path.write_text(text, encoding="utf-8-sig")
    return path


def _shares(person: np.ndarray) -> np.ndarray:
    """x, y, z, visibility of each landmark; NaN where it was not found."""
    xy = person[:, :2] / SIZE
    return np.column_stack([xy, np.zeros(len(xy)), person[:, 2]])


def _csv(path: Path, rows: list[Any]) -> Path:
    with path.open("w", newline="") as stream:
        csv.writer(stream).writerows(
            [["" if isinstance(c, float) and np.isnan(c) else c for c in row] for row in rows]
        )
    return path


def _folder(path: Path, contents: dict[str, Any]) -> Path:
    path.mkdir()
    for name, content in contents.items():
        _json(path / f"{name}.json", content)
    return path
