"""Contact sheet of fitted hands: `python tools/hands_picture.py taichi out.jpg`.

One row per video, columns at equal times, each a crop of one hand, left and right in turn:
detected points as dots, the fitted hand as lines. The action must have been run.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from imocap_core.artifacts.schemas import CameraMotion, Hands, Keypoints, RefineSync
from imocap_core.artifacts.store import Store
from imocap_core.camera.projection import warp
from imocap_core.io.video import read_rgb

ROOT = Path(__file__).resolve().parents[1]
COLUMNS, TILE, HALF_PX = 10, 144, 36
LINES = [(0, 4 * f + 1) for f in range(5)]
LINES += [(4 * f + k, 4 * f + k + 1) for f in range(5) for k in (1, 2, 3)]
COLORS = ((250, 220, 60), (80, 235, 255))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("action")
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    sheet = picture(ROOT, arguments.action)
    cv2.imwrite(str(arguments.out), sheet[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 80])


def picture(root: Path, action: str) -> np.ndarray:
    """RGB sheet."""
    store = Store(root / "artifacts")
    kinds = {"keypoints": Keypoints, "camera_motion": CameraMotion, "hands": Hands}
    stored = {s: store.load(action, s) for s in (*kinds, "refine_sync")}
    if any(one is None for one in stored.values()):
        raise SystemExit(f"{action} has not been run: imocap run {action}")
    keypoints, turned, hands = (stored[s].decode(kind) for s, kind in kinds.items())
    cameras = {c.id: c.K for c in stored["refine_sync"].decode(RefineSync).motion.cameras}
    rows = []
    for video, camera, fitted in zip(keypoints.videos, turned.videos, hands.videos, strict=True):
        images = [image for _, image in read_rgb(root / "actions" / action / video.video)]
        h = fitted.points_m @ cameras[video.id].T
        xy = (h[..., :2] / h[..., 2:]).reshape(len(fitted.frames), 42, 2)
        back = np.linalg.inv(camera.H_first_from_frame)
        xy = warp(back[:, None], xy).reshape(-1, 2, 21, 2)
        chosen = np.linspace(0, len(xy) - 1, COLUMNS + 2).round().astype(int)[1:-1]
        tiles = []
        for k, t in enumerate(chosen):
            side = k % 2
            image = images[video.frames[t]]
            tiles.append(tile(image, xy[t, side], video.hands.xy_px[t, side], COLORS[side]))
        rows.append(np.hstack(tiles))
    return np.vstack(rows)


def tile(image: np.ndarray, fit: np.ndarray, detected: np.ndarray, color: tuple) -> np.ndarray:
    """A crop of a hand; fitted and detected points (21, 2) in pixels."""
    low = np.round(fit.mean(axis=0)).astype(int) - HALF_PX
    padded = cv2.copyMakeBorder(image, *[2 * HALF_PX] * 4, cv2.BORDER_REPLICATE)
    y, x = low[1] + 2 * HALF_PX, low[0] + 2 * HALF_PX
    crop = padded[y : y + 2 * HALF_PX, x : x + 2 * HALF_PX]
    crop = cv2.resize(crop, (TILE, TILE), interpolation=cv2.INTER_CUBIC)
    place = TILE / (2 * HALF_PX)
    corners = [tuple(p) for p in np.round(((fit - low) + 0.5) * place).astype(int).tolist()]
    for a, b in LINES:
        cv2.line(crop, corners[a], corners[b], color, 1, cv2.LINE_AA)
    for point in detected[np.isfinite(detected).all(axis=1)]:
        p = np.round(((point - low) + 0.5) * place).astype(int).tolist()
        cv2.circle(crop, tuple(p), 2, (255, 80, 60), -1, cv2.LINE_AA)
    return crop


if __name__ == "__main__":
    main()
