"""Files of other programs, in and out.

detectors/    2D keypoints, one file a format
estimators/   monocular 3D estimates, one file a format
writers/      exports: BVH, GLB, TRC, CSV, npz, MCAP
video         frames of video files, and H.264 out
prefetch      a generator that runs a few items ahead, in a thread
truth         truth.npz, for scoring only; pose2sim_truth: a calibrated rig's files
npz           named arrays of npz files, checked
object_npz    Python objects in npz files; pickles: results stored as pickles
"""
