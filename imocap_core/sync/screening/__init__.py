"""Screening before the synchronisation: mirrored videos, and videos of another action.

Reading order:
    pose_evidence  evidence for mirrored videos and for videos of another action, from poses and
                   weights
    mirror         mirrored videos: the picture was flipped, or the performer has the other hand
    registration   registration of a video's keypoints with a motion: the best camera and the best
                   monotone warp
    explanation    how well the other videos' common motion explains a video: as it is, in a mirror,
                   or not at all
    decisions      which videos are mirrored, and which show another action, decided and said in
                   words
    screening      screening before the synchronisation: mirrored videos, and videos of another
                   action
"""
