"""Small results of every monocular estimator in its true form, of known rotations."""

import json
import pickle
import zlib
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from imocap_core.rotations import exp

SIZE = (640, 360)
FRAMES = 6


class NumpyArrayWrapper:
    """joblib's record of an array, under joblib's name (see `dump_joblib`)."""


NumpyArrayWrapper.__module__ = "joblib.numpy_pickle"


class _JoblibPickler(pickle._Pickler):
    """What joblib writes: an array is a record of its form, then its bytes, aligned to 16."""

    def save(self, obj: Any, *args: Any, **kwargs: Any) -> None:
        if type(obj) is not np.ndarray:
            super().save(obj, *args, **kwargs)
            return
        record = NumpyArrayWrapper()
        fortran = obj.flags.f_contiguous and not obj.flags.c_contiguous
        record.__dict__.update(
            subclass=np.ndarray, shape=obj.shape, order="F" if fortran else "C", dtype=obj.dtype,
            allow_mmap=not obj.dtype.hasobject, numpy_array_alignment_bytes=16,
        )  # fmt: skip
        super().save(record)
        self.framer.commit_frame(force=True)
        if obj.dtype.hasobject:
            pickle.dump(obj, self.raw, protocol=2)
            return
        pad = 16 - (self.raw.tell() + 1) % 16
        self.raw.write(bytes([pad]) + b"\xff" * pad + obj.tobytes(order="A"))

    def save_global(self, obj: Any, name: str | None = None) -> None:
        if obj is NumpyArrayWrapper:
            self.save("joblib.numpy_pickle")
            self.save("NumpyArrayWrapper")
            self.write(pickle.STACK_GLOBAL)
            self.memoize(obj)
        else:
            super().save_global(obj, name)

    dispatch = {**pickle._Pickler.dispatch, type: save_global}  # noqa: RUF012


def dump_joblib(content: Any, path: Path, *, compress: bool = False) -> Path:
    """`content` as joblib.dump writes it; compressed with zlib as its `compress=3` does."""
    with path.open("wb") as stream:
        pickler = _JoblibPickler(stream, protocol=4)
        pickler.raw = stream
        pickler.dump(content)
    if compress:
        path.write_bytes(zlib.compress(path.read_bytes(), 3))
    return path


@dataclass(frozen=True)
class Truth:
    """One person: theta (T, 72), rotations (T, 24, 3, 3), the box's middle (T, 2) pixels."""

    theta: np.ndarray
    R: np.ndarray
    middle_px: np.ndarray

    @property
    def box_px(self) -> np.ndarray:
        """x0, y0, x1, y1 of a person 40 pixels wide and 100 high."""
        return np.concatenate([self.middle_px - [20, 50], self.middle_px + [20, 50]], axis=1)


def person(seed: int, x: float) -> Truth:
    theta = np.random.default_rng(seed).normal(scale=0.4, size=(FRAMES, 72))
    R = exp(torch.as_tensor(theta.reshape(FRAMES, 24, 3))).numpy()
    return Truth(theta, R, np.column_stack([x + np.arange(FRAMES), np.full(FRAMES, 180.0)]))


PERFORMER, OTHER = person(1, 150.0), person(2, 450.0)
PEOPLE = (OTHER, PERFORMER)  # the other one comes first


def write_phalp(folder: Path, people: tuple[Truth, ...] = PEOPLE, **changes: Any) -> Path:
    content = {}
    for t in range(FRAMES):
        content[f"outputs/_DEMO/clip/img/{t + 1:06d}.jpg"] = {
            "time": t,
            "shot": 0,
            "tid": [np.int64(7 + n) for n in range(len(people))],
            "tracked_ids": [np.int64(7 + n) for n in range(len(people))],
            "tracked_time": [0] * len(people),
            "bbox": [np.array([*p.box_px[t, :2], 40.0, 100.0]) for p in people],
            "smpl": [
                {"global_orient": p.R[t, :1].astype("f4"), "body_pose": p.R[t, 1:].astype("f4"),
                 "betas": np.zeros(10, "f4")}
                for p in people
            ],
            "camera": [np.ones(3) for _ in people],
            "conf": [np.float32(0.9) for _ in people],
        } | changes  # fmt: skip
    return dump_joblib(content, folder / "demo_clip.pkl", compress=True)


def write_wham(folder: Path, people: tuple[Truth, ...] = PEOPLE, **changes: Any) -> Path:
    """As its demo: ids from np.unique, single-precision arrays."""
    results: defaultdict[np.int64, dict[str, Any]] = defaultdict(dict)
    focal = np.hypot(*SIZE)
    for n, p in zip(np.unique(np.arange(len(people))), people, strict=True):
        position = 5.0 * (p.middle_px - np.array(SIZE) / 2) / focal
        results[n] = {
            "pose": p.theta.astype("f4"),
            "trans": np.column_stack([position, np.full(FRAMES, 5.0)]).astype("f4"),
            "pose_world": p.theta[::-1].astype("f4"),
            "trans_world": np.zeros((FRAMES, 3), "f4"),
            "betas": np.zeros((FRAMES, 10), "f4"),
            "verts": np.zeros((FRAMES, 9, 3), "f4"),
            "frame_ids": np.arange(FRAMES),
        } | changes
    return dump_joblib(results, folder / "wham_output.pkl")


def write_vibe(folder: Path, people: tuple[Truth, ...] = PEOPLE, **changes: Any) -> Path:
    results = {
        np.int32(n + 1): {
            "pred_cam": np.zeros((FRAMES, 3)),
            "pose": np.asfortranarray(p.theta),
            "betas": np.zeros((FRAMES, 10)),
            "joints2d": None,
            "bboxes": np.column_stack([p.middle_px, np.full((FRAMES, 2), 100.0)]),
            "frame_ids": np.arange(FRAMES),
        }
        | changes
        for n, p in enumerate(people)
    }
    return dump_joblib(results, folder / "vibe_output.pkl")


def write_hmmr(folder: Path, people: tuple[Truth, ...] = PEOPLE, **changes: Any) -> Path:
    content = {"poses": PERFORMER.R.astype("f4"), "cams": np.zeros((FRAMES, 3))} | changes
    path = folder / "hmmr_output.pkl"
    path.write_bytes(pickle.dumps(content, protocol=2))
    return path


def write_gvhmr(folder: Path, people: tuple[Truth, ...] = PEOPLE, **changes: Any) -> Path:
    theta = torch.as_tensor(PERFORMER.theta).float()
    in_camera = {"global_orient": theta[:, :3].clone(), "body_pose": theta[:, 3:66].clone(),
                 "betas": torch.zeros(FRAMES, 10), "transl": torch.zeros(FRAMES, 3)}  # fmt: skip
    content = {"smpl_params_incam": in_camera | changes, "smpl_params_global": {},
               "K_fullimg": torch.eye(3).expand(FRAMES, 3, 3), "net_outputs": {}}  # fmt: skip
    path = folder / "hmr4d_results.pt"
    torch.save(content, path)
    return path


def write_gem(folder: Path, people: tuple[Truth, ...] = PEOPLE, **changes: Any) -> Path:
    content = torch.load(write_gvhmr(folder, people, **changes), weights_only=True)
    content["body_params_incam"] = content.pop("smpl_params_incam")
    path = folder / "smpl_params.pt"
    torch.save(content, path)
    return path


def write_prompthmr(folder: Path, people: tuple[Truth, ...] = PEOPLE, **changes: Any) -> Path:
    results = {
        "camera": {}, "camera_world": {"Rwc": np.tile(np.eye(3), (FRAMES, 1, 1))}, "has_slam": True,
        "people": {
            np.int64(n + 1): {
                "track_id": np.int64(n + 1),
                "frames": np.arange(FRAMES),
                "bboxes": p.box_px,
                "smplx_cam": {
                    "pose": np.pad(p.theta[:, :66], ((0, 0), (0, 99))).astype("f4"),
                    "shape": np.zeros((FRAMES, 10)), "trans": np.zeros((FRAMES, 3)),
                },
                "smplx_world": {"pose": np.zeros((FRAMES, 165))},
            } | changes
            for n, p in enumerate(people)
        },
    }  # fmt: skip
    return dump_joblib(results, folder / "results.pkl")


def write_tram(folder: Path, people: tuple[Truth, ...] = PEOPLE, **changes: Any) -> Path:
    path = folder / "hps"
    path.mkdir()
    for n, p in enumerate(people):
        position = np.column_stack([(p.middle_px - np.array(SIZE) / 2) / 100, np.full(FRAMES, 5.0)])
        content = {
            "pred_cam": torch.zeros(FRAMES, 3),
            "pred_rotmat": torch.as_tensor(p.R).float(),
            "pred_shape": torch.zeros(FRAMES, 10),
            "pred_trans": torch.as_tensor(position[:, None]),
            "frame": torch.arange(FRAMES),
            "img_focal": np.float64(500.0),
            "img_center": np.array(SIZE) / 2,
        } | changes
        np.save(path / f"hps_track_{n}.npy", np.array(content, dtype=object), allow_pickle=True)
    return path


def joints_of(p: Truth, count: int = 70) -> np.ndarray:
    """Joints (T, count, 3) that tell the people apart."""
    return np.random.default_rng(int(p.middle_px[0, 0])).normal(size=(FRAMES, count, 3)).round(4)


def write_sam3d_body(folder: Path, people: tuple[Truth, ...] = PEOPLE, **changes: Any) -> Path:
    content = [
        [{"pred_keypoints_3d": joints_of(p)[t].tolist(), "bbox": p.box_px[t].tolist()} | changes
         for p in people]
        for t in range(FRAMES)
    ]  # fmt: skip
    path = folder / "sam3d.json"
    path.write_text(json.dumps(content))
    return path


def write_mediapipe(folder: Path, people: tuple[Truth, ...] = PEOPLE, **changes: Any) -> Path:
    content = [
        {
            "frame": t,
            "pose_landmarks": [
                [{"x": p.middle_px[t, 0] / SIZE[0], "y": p.middle_px[t, 1] / SIZE[1],
                  "z": 0.0, "visibility": 1.0}] * 33
                for p in people
            ],
            "pose_world_landmarks": [
                [dict(zip("xyz", xyz, strict=True)) for xyz in joints_of(p, 33)[t].tolist()]
                for p in people
            ],
        } | changes
        for t in range(FRAMES)
    ]  # fmt: skip
    path = folder / "landmarks.json"
    path.write_text(json.dumps(content))
    return path
