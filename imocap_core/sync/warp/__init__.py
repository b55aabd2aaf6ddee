"""Time warping: the position of every frame of a video in another video.

Reading order:
    dtw            dynamic time warping with open ends (Sakoe and Chiba 1978)
    dtw_paths      the paper's last step: one DTW path on each relaxed block
    monotone       posterior over all monotone warps (forward-backward)
    rate_prior     Markov chain of a performance's rate
    smooth_rate    posterior over all warps of slowly changing rate
    clocks         frames per second of the action
    playback_rate  slow motion and time lapse, from the poses
    positions      median, monotone order and confidence from a soft map
    soft_maps      soft maps of all pairs of videos from squared distances
    template       precision-weighted mean of all videos on the reference axis
    leave_one_out  squared distances of each video to the template of the others
    reprojection   squared reprojection errors against the motion of the others
"""
