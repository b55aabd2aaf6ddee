"""Time warping: the position of every frame of a video in another video.

Reading order: dtw, monotone, rate, soft_maps, template, leave_one_out_template,
reprojection_evidence.
"""
