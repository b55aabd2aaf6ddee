"""Technique: what the performances of one action share, and how they differ (docs/technique.md).

Reading order:
    performances   performances at the same phases, on one body, turned to one facing direction
    mean_motion    the chordal mean, and every performance's deviation from it
    consistency    share of the motion that the moment explains (Kadaba et al. 1989)
    modes          principal components of the deviations (Eq. 4 with the mean removed)
    difference     two mean motions compared, in units of the spread of repetitions
"""
