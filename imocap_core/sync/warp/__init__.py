"""Time warping: the position of every frame of a video in another video.

Reading order:
    dtw                     dynamic time warping with open ends, and the paper's last step: a path
                            on each relaxed block
    monotone                posterior over all monotone warps: the position of each frame of a video
                            in another one
    rate                    posterior over all warps of slowly changing rate, its prior, and
                            playback rates of videos
    soft_maps               soft maps from squared distances: P(position in another video | frame)
    template                template: the mean of the videos' poses; positions of frames in it, and
                            squared distances
    leave_one_out_template  squared distances of each video to the template made of the other videos
    reprojection_evidence   reprojection evidence: each frame's keypoints against the projected
                            motion of the other videos
"""
