"""The viewer: one HTML file that plays all videos in one scene."""
