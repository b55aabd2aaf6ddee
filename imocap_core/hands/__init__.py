"""Hands after the body: fingers and wrists from 2 x 21 keypoints, in all videos at once."""
