"""Metrics, one function each; docs/metrics.md defines them all in words.

Reading order:
    joints          the joints that are compared, relative to the midpoint of the hips
    position        MPJPE, scaled MPJPE, P-MPJPE, acceleration error
    trajectory      errors of the root path, foot sliding
    whole_body      errors of joints that are not aligned on, vertex errors
    joint_rotations errors of joint rotations (MPJAE)
    world           W-MPJPE, WA-MPJPE, RTE, jitter, foot sliding as published
    mesh_stretch    stretched edges and torso volume of a surface; needs no truth
    hands           the position metrics for the 21 keypoints of each hand
    camera          rotation error of a camera, reprojection error
    sync            synchronisation errors by the phase of the true motion; cycle residual
    calibration     errors in units of the claimed standard deviation
    scoring         all of them for one video, as rows of a table
    body_scoring    the same for whole-body and world metrics
"""
