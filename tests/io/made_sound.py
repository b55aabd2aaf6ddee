"""Recordings of one event by different microphones, and films with a sound track."""

from pathlib import Path

import av
import numpy as np
from jaxtyping import Float
from scipy.signal import butter, sosfilt

RATE = 48_000


def event(seconds: float, seed: int = 0, rate: int = RATE) -> Float[np.ndarray, " N"]:
    """Steps and claps at irregular times, over a murmur."""
    rng = np.random.default_rng(seed)
    sound = 0.02 * rng.standard_normal(round(seconds * rate))
    for time in np.cumsum(rng.uniform(0.15, 1.1, round(2 * seconds))):
        length = round(rng.uniform(0.02, 0.15) * rate)
        first = round(time * rate)
        if first + length > len(sound):
            break
        decay = np.exp(-5 * np.arange(length) / length)
        sound[first : first + length] += rng.uniform(0.3, 1.0) * decay * rng.standard_normal(length)
    return sound


def loop(seconds: float, period_s: float = 0.5, seed: int = 1) -> Float[np.ndarray, " N"]:
    """A bar of music that repeats exactly."""
    bar = event(period_s, seed)[: round(period_s * RATE)]
    bar[: RATE // 50] += 1.0
    return np.tile(bar, round(seconds / period_s))


def recorded(
    sound: Float[np.ndarray, " N"],
    start_s: float,
    seconds: float,
    *,
    band_hz: tuple[float, float] = (80.0, 8000.0),
    gain: float = 1.0,
    noise: float = 0.0,
    seed: int = 0,
) -> Float[np.ndarray, " N"]:
    """What a microphone of some band and gain records from start_s on, with noise of its own."""
    part = sound[round(start_s * RATE) : round((start_s + seconds) * RATE)]
    filtered = sosfilt(butter(2, band_hz, "band", fs=RATE, output="sos"), part)
    own = noise * filtered.std() * np.random.default_rng(seed).standard_normal(len(filtered))
    return np.asarray(gain * (filtered + own))


def write_film(path: Path, sound: Float[np.ndarray, " N"] | None, seconds: float) -> Path:
    """A grey film of 30 frames a second with a sound track (AAC), or without one."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        track = None if sound is None else container.add_stream("aac", rate=RATE)
        for number in range(round(30 * seconds)):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 90, np.uint8), format="rgb24")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
        if sound is not None and track is not None:
            samples = np.clip(sound, -1, 1).astype(np.float32)[None]
            audio = av.AudioFrame.from_ndarray(samples, "fltp", "mono")
            audio.rate, audio.pts = RATE, 0
            container.mux(track.encode(audio))
            container.mux(track.encode())
    return path
