"""Motion and cameras of all videos from 2D keypoints: residuals, solver, fits (Eq. 3 to 8)."""
