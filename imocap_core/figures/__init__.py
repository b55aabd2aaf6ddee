"""Figures drawn from artifacts and arrays.

Reading order:
    overlays        keypoints, skeletons and bodies over crops of the videos' frames, and grids of
                    them
    sync_summary    a synchronisation as one row per video, and the frame of a video that shows each
                    moment
    style           one style for all figures and for text on pictures; image files without date and
                    machine
    sheets          sheets of pictures: contact sheets of the videos, bodies from three sides,
                    several results
    sync_figures    figures of synchronisation: affinities, warps, pace, confidence, rounds of the
                    loop
    page_figures    round trips over three videos, standard deviations of joints, joint angles
    result_figures  plots of results: camera poses and root paths, errors of joints
"""
