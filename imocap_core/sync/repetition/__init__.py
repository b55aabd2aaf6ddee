"""Repetitions of one action in a long clip.

Reading order:
    template_matching   occurrences of a part of a clip: subsequence DTW, then interval scheduling
    segmentation        the clip cut into the repetitions of its dominant action
"""
