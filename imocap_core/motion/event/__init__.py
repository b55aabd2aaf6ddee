"""One event filmed by several cameras: their calibration from the person they show."""
