"""Screening before the synchronisation: mirrored videos, and videos of another action.

Reading order:
    warp_residual          root-mean-square pose distance of two videos along their best warp
    temporal_order         gain of the order of time: residual in scrambled over that in true order
    persistent_difference  residual with a slowly changing rotation, noise of one side averaged out
    mirror                 signs s_i s_j = -1 where reflection fits better
    outliers               scores of videos that lie far from the others
    evidence               these quantities from the poses of all videos
    screening              the decision: excluded, flipped, reported
    messages               the decision in words
"""
