"""Pairwise comparison of the frames of all videos (section 3.1, above Eq. 1).

Reading order:
    poses             input checks, joint weights, body scale
    procrustes        d_ab = min over R, t of |a - (R b + t)|, in closed form for all pairs
    velocity          joint velocities as further points of a pose
    distance_matrix   all squared distances, with the typical squares of matching and other pairs
    affinity          Eq. 1: affinities in [0, 1] from distances
    banded            products with soft maps, in proportion to the frames
    rigid_alignment   the rotation itself (Kabsch), constant or changing slowly
    view_distance     weighted distances in the axes of one camera, once videos are aligned
    whitening         features of joints in which errors are independent
"""
