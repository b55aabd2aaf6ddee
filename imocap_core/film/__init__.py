"""Films: the bodies over every video, and all videos in lock-step."""
