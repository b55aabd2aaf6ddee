"""Motion capture from several unsynchronised, uncalibrated videos."""
