"""What a run gave for one video: motion, camera, time and uncertainty as arrays.

Which frames of an action's videos show the same moment, as values. Indices: T used frames, J joints
(24 of SMPL, or 52 of SMPL+H where the video has hands).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int, Real, UInt8

from imocap_core.artifacts.schemas import SyncSummary, VideoKeypoints
from imocap_core.camera.projection import Lens, camera_from_world, frame_projections
from imocap_core.conventions import SMPL_JOINTS, SMPLH_JOINTS
from imocap_core.errors import WorkFailed, WrongUse
from imocap_core.sequences import index_at

STATIC_TOLERANCE = 1e-9  # a camera whose rotations differ by less is static


@dataclass(frozen=True, eq=False)
class VideoCamera:
    """A camera, which may turn, zoom and move; OpenCV's axes (x right, y down, z forward),
    pixels, metres.

    Attributes:
        id: the video.
        size: width and height of the picture, pixels.
        K: intrinsics (3, 3) of the first used frame, pixels.
        R, t: camera from world in the first used frame: x_cam = R x_world + t, t in metres.
        R_first_from_frame: (T, 3, 3) rotation from each frame's camera axes to the first frame's.
        zoom: (T,) focal length of each frame over the first frame's.
        H_first_from_frame: (T, 3, 3) homographies from each frame's pixels to the first frame's,
            as they were measured on the background.
        path_m: (T, 3) its places in the first frame's axes, metres; None on one spot, or where the
            path is unknown.
        lens: its distortion; None: a pinhole. A zoom moves pixels as the first frame's lens does.
            K, R, t, H_first_from_frame and P_frame_from_first are of pictures without it.
    """

    id: str
    size: tuple[int, int]
    K: Float[np.ndarray, "3 3"]
    R: Float[np.ndarray, "3 3"]
    t: Float[np.ndarray, " 3"]
    R_first_from_frame: Float[np.ndarray, "T 3 3"]
    zoom: Float[np.ndarray, " T"]
    H_first_from_frame: Float[np.ndarray, "T 3 3"]
    path_m: Float[np.ndarray, "T 3"] | None = None
    lens: Lens | None = None

    @property
    def distortion(self) -> Float[np.ndarray, " 5"]:
        """OpenCV's k1, k2, p1, p2, k3, relative to K; 0 for a pinhole."""
        return self.distortion_at(self.K)

    def distortion_at(self, K: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, " 5"]:
        """The same lens, relative to the focal length of another zoom."""
        return np.zeros(5) if self.lens is None else self.lens.relative_to(K).coefficients

    @property
    def is_static(self) -> bool:
        """Whether the camera neither turns, zooms nor moves."""
        if self.path_m is not None:
            return False
        turned = np.abs(self.R_first_from_frame - np.eye(3)).max() > STATIC_TOLERANCE
        return not turned and float(np.ptp(self.zoom)) <= STATIC_TOLERANCE

    @property
    def centre(self) -> Float[np.ndarray, " 3"]:
        """Position of the camera in the world in the first used frame, metres."""
        return -self.R.T @ self.t

    @property
    def centre_per_frame(self) -> Float[np.ndarray, "T 3"]:
        """Position of the camera in the world in every used frame, metres."""
        moved = np.zeros((len(self.zoom), 3)) if self.path_m is None else self.path_m
        return self.centre + moved @ self.R

    @property
    def t_per_frame(self) -> Float[np.ndarray, "T 3"]:
        """Translation camera from world of every used frame, metres."""
        return -np.einsum("tij,tj->ti", self.R_per_frame, self.centre_per_frame)

    @property
    def K_per_frame(self) -> Float[np.ndarray, "T 3 3"]:
        """Intrinsics of every used frame, pixels."""
        from imocap_core.camera.zooming import lens_of

        return lens_of(self.K, self.zoom)

    @property
    def R_per_frame(self) -> Float[np.ndarray, "T 3 3"]:
        """Rotation camera from world of every used frame."""
        return self.R_first_from_frame.swapaxes(1, 2) @ self.R

    @property
    def P_frame_from_first(self) -> Float[np.ndarray, "T 3 3"]:
        """Of every frame, see `frame_projections`."""
        return frame_projections(self.H_first_from_frame, self.K)

    def project(
        self, points_m: Float[np.ndarray, "... 3"], index: Int[np.ndarray, " F"] | None = None
    ) -> Float[np.ndarray, "F N 2"]:
        """Pixels of world points in every used frame, or in the used frames `index`, as the lens
        shows them.

        Args:
            points_m: (N, 3) metres, the same points for all frames, or (F, N, 3), those of each.
            index: (F,) positions among the used frames; all T of them when left out.

        NaN for points not in front of the camera.
        """
        P = self.P_frame_from_first if index is None else self.P_frame_from_first[index]
        ahead = camera_from_world(points_m, self.R, self.t)
        if self.path_m is not None:
            path = self.path_m if index is None else self.path_m[index]
            ahead = ahead - path[:, None]
        homogeneous = np.broadcast_to(ahead, (len(P), *ahead.shape[-2:])) @ P.swapaxes(1, 2)
        depth = np.where(homogeneous[..., 2:] > 0, homogeneous[..., 2:], np.nan)
        straight = np.asarray(homogeneous[..., :2] / depth)
        return straight if self.lens is None else self.lens.distorted(straight)


@dataclass(frozen=True, eq=False)
class FrameMatches:
    """For every used frame of one video the frame of another that shows the same moment.

    index (T,): fractional position among the other video's used frames. frame (T,): the same as a
    fractional source frame number. confidence (T,): 0 to 1. NaN, NaN and 0 where none does.
    """

    index: Float[np.ndarray, " T"]
    frame: Float[np.ndarray, " T"]
    confidence: Float[np.ndarray, " T"]


@dataclass(frozen=True, eq=False)
class VideoSync:
    """One video's place on the common time axis.

    Attributes:
        id: the video.
        fps: its frames per second.
        frames: (T,) source frame numbers of its used frames; fractional where the frame rate is
            variable.
        reference_frame: (T,) fractional position among the reference's used frames, NaN unmatched.
        confidence: (T,) 0 to 1.
        phase_s: (T,) place on the time axis of all videos, seconds of the reference; NaN unknown.
    """

    id: str
    fps: float
    frames: Real[np.ndarray, " T"]
    reference_frame: Float[np.ndarray, " T"]
    confidence: Float[np.ndarray, " T"]
    phase_s: Float[np.ndarray, " T"]


@dataclass(frozen=True, eq=False)
class Synchronisation:
    """The correspondences of all videos.

    videos: by id, in the order of the action; also `sync[id]`. summary: the stored artifact.
    """

    videos: Mapping[str, VideoSync]
    summary: SyncSummary

    @property
    def ids(self) -> tuple[str, ...]:
        """The videos."""
        return tuple(self.videos)

    @property
    def reference(self) -> str:
        """The video whose time axis is used."""
        return self.summary.reference

    @property
    def excluded(self) -> tuple[str, ...]:
        """Videos of another action, unmatched throughout."""
        return tuple(self.summary.excluded)

    @property
    def mirrored(self) -> tuple[str, ...]:
        """Videos treated as their mirror image."""
        return tuple(self.summary.mirrored)

    @property
    def status(self) -> str:
        """One sentence on the result."""
        return self.summary.status

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about single videos."""
        return tuple(self.summary.notes)

    def __getitem__(self, video: str) -> VideoSync:
        """One video; WrongUse when there is none of this id."""
        if video not in self.videos:
            raise WrongUse(f"no video {video!r}; there are: {', '.join(self.videos)}")
        return self.videos[video]

    def matches(self, video: str, other: str) -> FrameMatches:
        """For every used frame of `video` the frame of `other` that shows the same moment.

        Against the reference these are the correspondences of the artifact; between two other
        videos the frames at equal phases, with the lower of both confidences.
        """
        one, two = self[video], self[other]
        if other == self.reference:
            index, confidence = one.reference_frame, one.confidence
        else:
            index = index_at(two.phase_s, one.phase_s)
            theirs = np.interp(index, np.arange(len(two.frames)), two.confidence)
            confidence = np.minimum(one.confidence, theirs)
        matched = np.isfinite(index)
        frame = np.interp(index, np.arange(len(two.frames)), two.frames)
        return FrameMatches(
            index=index,
            frame=np.where(matched, frame, np.nan),
            confidence=np.where(matched, confidence, 0.0),
        )


def synchronisation_of(
    summary: SyncSummary, frames: Mapping[str, Real[np.ndarray, " _"]], fps: Mapping[str, float]
) -> Synchronisation:
    """From the artifact; frames: per video, the source frame numbers of its used frames."""
    videos = {
        m.id: VideoSync(
            id=m.id,
            fps=fps[m.id],
            frames=frames[m.id],
            reference_frame=m.reference_frame,
            confidence=np.where(np.isfinite(m.reference_frame), np.nan_to_num(m.confidence), 0.0),
            phase_s=summary.phases.get(m.id, np.full(len(m.reference_frame), np.nan)),
        )
        for m in summary.maps
    }
    return Synchronisation(videos, summary)


WRISTS = SMPL_JOINTS.index("left_wrist")  # the right one follows; then joints that hands replace


@dataclass(frozen=True, eq=False)
class HandMotion:
    """Hands of one video, left then right.

    wrists (T, 2, 3), fingers (T, 2, 15, 3): axis-angle radians against the joint before, in
    SMPL+H's order. points (T, 2, 21, 3): OpenPose's 21 points, world, metres. visible (T, 2): False
    where no keypoints were used.
    """

    wrists: Float[np.ndarray, "T 2 3"]
    fingers: Float[np.ndarray, "T 2 15 3"]
    points: Float[np.ndarray, "T 2 21 3"]
    visible: Bool[np.ndarray, "T 2"]


@dataclass(frozen=True, eq=False)
class JointUncertainty:
    """Standard deviations of one video's joints about the middle of the hips, and of its rotations.

    sigma_mm (T, 24): root of the covariance's trace. covariance_mm2 (T, 24, 3, 3): in the axes of
    the camera's first used frame. rotation_covariance_deg2 (T, 15, 3, 3): of the anatomical
    joints' rotations, in the axes of their distal segments; deviation_covariance_deg2: the same
    with the motion common to all videos given. camera_sd_deg: of the camera's rotation about the
    reference's, three axes together. NaN where unknown.
    """

    sigma_mm: Float[np.ndarray, "T 24"]
    covariance_mm2: Float[np.ndarray, "T 24 3 3"]
    rotation_covariance_deg2: Float[np.ndarray, "T 15 3 3"]
    deviation_covariance_deg2: Float[np.ndarray, "T 15 3 3"]
    camera_sd_deg: float


@dataclass(frozen=True, eq=False)
class VideoMoment:
    """What one video shows of a moment.

    index: fractional position among its used frames. frame: fractional source frame number.
    time_s: seconds from the beginning of the file. joints (J, 3): world, metres. confidence: 0
    to 1.
    """

    index: float
    frame: float
    time_s: float
    joints: Float[np.ndarray, "J 3"]
    confidence: float


@dataclass(frozen=True, eq=False)
class VideoResult:
    """One video of a result, in the result's world.

    Attributes:
        id: the video. action: the action that it belongs to.
        keypoints: its 2D detections: xy_px (T, K, 2), confidence (T, K), layout, size, fps.
        video: the file; None where action.yaml names none or it is not there.
        camera: where it was filmed from (`VideoCamera`).
        fps: frames per second of the arrays here.
        frames: (T,) source frame numbers; fractional on the common time axis, and of a video of
            variable frame rate, which is read at even moments.
        inside: (T,) False where the video does not show the moment and its nearest end stands in.
        phase_s: (T,) place on the common time axis, seconds of the reference; NaN unknown.
        confidence: (T,) 0 to 1, of every frame's match with the reference video.
        theta: (T, 72) axis-angle radians, SMPL's 24 joints; the first turns the body in the world.
        betas: (10,) shape coefficients of the body model.
        trans: (T, 3) metres, SMPL's translation (as in smplx).
        body_joints: (T, 24, 3) SMPL's joints, world, metres.
        hands: fingers and wrists; None where the keypoints have no hands.
        reprojection_px: (T,) mean distance of the projected keypoints from the detected ones.
        joint_uncertainty: None where the stage `uncertainty` has not run.
        sync: the synchronisation of all videos.
        model: name and digest of the body model.
    """

    id: str
    action: str
    keypoints: VideoKeypoints
    video: Path | None
    camera: VideoCamera
    fps: float
    frames: Int[np.ndarray, " T"] | Float[np.ndarray, " T"]
    inside: Bool[np.ndarray, " T"]
    phase_s: Float[np.ndarray, " T"]
    confidence: Float[np.ndarray, " T"]
    theta: Float[np.ndarray, "T 72"]
    betas: Float[np.ndarray, " 10"]
    trans: Float[np.ndarray, "T 3"]
    body_joints: Float[np.ndarray, "T 24 3"]
    hands: HandMotion | None
    reprojection_px: Float[np.ndarray, " T"]
    joint_uncertainty: JointUncertainty | None
    sync: Synchronisation
    model: str

    def __len__(self) -> int:
        """How many frames were used."""
        return len(self.frames)

    def __repr__(self) -> str:
        return f"<VideoResult {self.id}: {len(self)} frames, {len(self.joint_names)} joints>"

    @property
    def performer(self) -> str | None:
        """Who performs, as action.yaml declares; None where it does not."""
        return self.keypoints.performer

    @property
    def joint_names(self) -> tuple[str, ...]:
        """(J,) SMPL's 24 names, or SMPL+H's 52 where the video has hands."""
        return tuple(SMPL_JOINTS if self.hands is None else SMPLH_JOINTS)

    @cached_property
    def joints(self) -> Float[np.ndarray, "T J 3"]:
        """(T, J, 3) joints in the world, metres; J as `joint_names`."""
        if self.hands is None:
            return self.body_joints
        from imocap_core.result.body import body_model, posed_joints

        model = body_model(self.model, self.action, hands=True)
        return posed_joints(model, self.betas, self.poses, self.trans)

    @cached_property
    def poses(self) -> Float[np.ndarray, "T P"]:
        """(T, 3 J) axis-angle radians: every joint against its parent, the first in the world."""
        if self.hands is None:
            return self.theta
        parts = [self.theta[:, : 3 * WRISTS], self.hands.wrists, self.hands.fingers]
        return np.concatenate([part.reshape(len(self), -1) for part in parts], axis=1)

    @cached_property
    def rotations(self) -> Float[np.ndarray, "T J 3 3"]:
        """(T, J, 3, 3) rotations: every joint against its parent, the first in the world."""
        from imocap_core.result.body import local_rotations

        return local_rotations(self.poses)

    def vertices(self, index: Int[np.ndarray, " F"] | None = None) -> Float[np.ndarray, "F V 3"]:
        """(F, V, 3) surface of the body in the world, metres.

        index: (F,) positions among the used frames; all T of them when left out. WorkFailed when
        this version of the program has another body model than the result.
        """
        from imocap_core.result.body import body_model, posed_surface

        model = body_model(self.model, self.action, hands=self.hands is not None)
        part = slice(None) if index is None else index
        return posed_surface(model, self.betas, self.poses[part], self.trans[part])

    @cached_property
    def faces(self) -> Int[np.ndarray, "F 3"]:
        """(F, 3) triangles of the surface, by vertex."""
        from imocap_core.result.body import body_model

        return body_model(self.model, self.action, hands=self.hands is not None).faces.numpy()

    def picture(self, index: int) -> UInt8[np.ndarray, "H W 3"]:
        """(H, W, 3) RGB picture of one used frame, by its position among them.

        WorkFailed when there is no video file, it is no readable video, or it ends before.
        """
        from imocap_core.io.video import read_rgb

        if self.video is None:
            raise WorkFailed(f"{self.id}: there is no video file to read the frame from")
        frame = int(self.keypoints.frames[index])
        try:
            for _, picture in read_rgb(self.video, frame, frame + 1):
                return picture
        except ValueError as error:
            raise WorkFailed(str(error)) from None
        raise WorkFailed(f"{self.video}: ends before frame {frame}")

    @property
    def time_s(self) -> Float[np.ndarray, " T"]:
        """(T,) seconds from the beginning of the video file."""
        return self.keypoints.seconds_of(self.frames)

    @property
    def uncertainty(self) -> Float[np.ndarray, "T 24"] | None:
        """(T, 24) standard deviation of SMPL's joints about the middle of the hips, mm.

        NaN where unknown; None where the stage `uncertainty` has not run.
        """
        return None if self.joint_uncertainty is None else self.joint_uncertainty.sigma_mm

    @property
    def joint_sd_mm(self) -> dict[str, Float[np.ndarray, " T"]]:
        """The same by joint; empty where the stage `uncertainty` has not run."""
        sigma = self.uncertainty
        return {} if sigma is None else dict(zip(SMPL_JOINTS, sigma.T, strict=True))

    @property
    def covariance_mm2(self) -> Float[np.ndarray, "T 24 3 3"] | None:
        """(T, 24, 3, 3) covariance of SMPL's joints about the middle of the hips, world axes, mm^2.

        None where the stage `uncertainty` has not run.
        """
        if self.joint_uncertainty is None:
            return None
        R = self.camera.R
        return np.asarray(R.T @ self.joint_uncertainty.covariance_mm2 @ R)

    def matches(self, other: VideoResult | str) -> FrameMatches:
        """For every used frame of this video the frame of another that shows the same moment."""
        return self.sync.matches(self.id, other if isinstance(other, str) else other.id)

    def joint(self, name: str) -> Float[np.ndarray, "T 3"]:
        """(T, 3) one joint in the world, metres. WrongUse when there is none of this name."""
        if name not in self.joint_names:
            raise WrongUse(f"no joint {name!r}; there are: {', '.join(self.joint_names)}")
        return self.joints[:, self.joint_names.index(name)]
