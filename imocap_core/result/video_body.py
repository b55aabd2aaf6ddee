"""The body of one video's performer, as the body model's own values."""

from __future__ import annotations

import torch

from imocap_core.body import Model, Shaped
from imocap_core.result.body import body_model
from imocap_core.result.video import VideoResult


def body_model_of(video: VideoResult, hands: bool) -> Model:
    """The body model that a video was captured with, with fingers (52 joints) when `hands`.

    WorkFailed when this version of the program has another one.
    """
    return body_model(video.model, video.action, hands)


def shaped_body(video: VideoResult) -> Shaped:
    """The performer's body at rest; with fingers where the video has hands."""
    model = body_model_of(video, hands=video.hands is not None)
    return model.shape(torch.as_tensor(video.betas))
