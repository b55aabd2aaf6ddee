"""`imocap collect`: from long films to the videos of an action.

Reading order:
    bars, gradual, shots    a film cut into its shots
    tracks                  the people of each shot, followed and lifted to 3D
    features, matching      a template's occurrences in all tracks, at any speed, mirrored too
    dominant                the template where no example is given
    takes                   replays and duplicates: the same take shown again
    choice                  the occurrences that become videos, and the reasons of the others
    listing, writing        collected.json and action.yaml
    collect                 all of it
"""
