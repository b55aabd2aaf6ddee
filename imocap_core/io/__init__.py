"""Files of other programs, in and out.

Reading order:
    hdf5_trial    read all of an HDF5 file, and do nothing with it: python -m
                  imocap_core.io.hdf5_trial FILE
    colmap        structure from motion by COLMAP (pycolmap, the optional extra `moving`) from
                  feature tracks
    array_files   arrays of HDF5 and pickled files, checked; Python objects are read without running
                  code
    npz           shared by the npz formats: named arrays, checked; rows selected by frame number
    video         video files: properties, frames and sound one by one as shown, and H.264 out, by
                  PyAV (FFmpeg)
    frame_access  frames of a video: any by its number, ahead of their consumer, their time stamps;
                  checks
    truth         true joints, cameras and phases, for scoring only: truth.npz, or a calibrated
                  rig's files
    readers/      readers of 2D keypoints, one file a format
    writers/      writers of exports, one file a format
"""
