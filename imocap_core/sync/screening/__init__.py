"""Screening before the synchronisation: mirrored videos, and videos of another action.

Reading order, where keypoints are given:
    registration           a video's keypoints under a motion, from fixed directions, warped
    best_camera            the best camera and warp, refined
    common_motion          the others' keypoints, triangulated
    explanation            each video against the others' common motion, as it is and reflected
    keypoint_decisions     margins and decisions

By poses alone:
    warp_residual          root-mean-square pose distance of two videos along their best warp
    temporal_order         gain of the order of time: residual in scrambled over that in true order
    persistent_difference  residual with a slowly changing rotation, noise of one side averaged out
    mirror                 signs s_i s_j = -1 where reflection fits better
    outliers               scores of videos that lie far from the others
    evidence               these quantities from the poses of all videos
    pose_decisions         the decisions

Both:
    decisions              what is decided, by whichever evidence
    screening              what is done about it: excluded, flipped, reported
    messages               the decision in words
"""
