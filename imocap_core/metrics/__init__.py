"""Metrics, one function each; docs/metrics.md defines them all in words.

Reading order:
    calibration  calibration of claimed standard deviations and probabilities
    sync         synchronisation errors by the phase of the true motion, and the cycle residual
    position     joint position errors, of bodies and of hands; a NaN joint or frame is left out
    trajectory   errors of the root path, of the motion in the world as published, and of cameras
    scoring      all metrics of one video as rows of a table, with the reason where one cannot be
                 scored
    whole_body   errors of the whole body: unaligned joints, joint rotations, the surface and its
                 distortion
"""
