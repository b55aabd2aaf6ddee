"""Figures drawn from artifacts and arrays.

style, lettering    one look for all figures; text on pictures
overlays            crops of frames, bodies and keypoints over them, contact sheets
contact_sheets      a sheet per video, and the same moments across all videos
body_sheet          the shaded body from front, side and back
results_sheet       the same frames under each result
bodies              body surfaces of an artifact's parameters
sync_summary        one row per video, and positions on the common time axis
sync_figures        affinities, warps, rounds; sync_picture: all of a synchronisation in one
cycle_trip          round trips over three videos; cycle_figure draws them
error_figure, scene_figure, uncertainty_figure
"""
