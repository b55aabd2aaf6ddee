"""Everybody who is followed in the films, ready to be compared with a movement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from imocap_core.collect.features import RATES, TrackSamples, at_rate, part_of, pooled, samples_of
from imocap_core.collect.films import LongFilm
from imocap_core.collect.tracks import ShotTrack, shot_tracks
from imocap_core.errors import WorkFailed
from imocap_core.params import KeypointsParams

MAX_POOL = 4000  # windows that tell how far anything is from the template


@dataclass(frozen=True)
class FilmTracks:
    """The tracks of all films, and of each its samples at every one of RATES."""

    tracks: list[ShotTrack]
    samples: list[list[TrackSamples]]

    def pool(self) -> TrackSamples:
        """Windows of everybody at the films' speed, evenly thinned out."""
        every = pooled([at_rate(rates, 1.0) for rates in self.samples])
        return part_of(every, slice(None, None, -(-len(every.frame) // MAX_POOL)))

    def of_shot(self, film: int, shot: int) -> list[int]:
        """Indices of the tracks of one shot."""
        return [i for i, t in enumerate(self.tracks) if (t.film, t.shot) == (film, shot)]


def film_tracks(films: Sequence[LongFilm], params: KeypointsParams) -> FilmTracks:
    """The people of all shots of some films. WorkFailed where there is nobody."""
    tracks = [
        track
        for number, film in enumerate(films)
        for track in shot_tracks(
            number, film.people, film.shots, params.min_confidence, params.max_gap_s
        )
    ]
    if not tracks:
        raise WorkFailed(
            "nobody moves in any shot: expected films in which people are large enough to be "
            "detected"
        )
    return FilmTracks(tracks, [[samples_of(track, rate) for rate in RATES] for track in tracks])
