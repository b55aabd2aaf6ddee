"""`imocap collect`: from long films to the videos of an action.

Reading order:
    bars, gradual, shots    a film cut into its shots
    tracks, films           the people of each shot, followed and lifted to 3D
    features, film_tracks   poses that can be compared from any view and at any speed
    matching, occurrences   a template's occurrences in all tracks, at any speed, mirrored too
    dominant, movement      the template: an example's movement, or the one that is repeated most
    replays, same_takes     replays and duplicates: the same take shown again
    choice                  the occurrences that become videos, and the reasons of the others
    listing, writing        collected.json and action.yaml
    collect                 all of it
"""
