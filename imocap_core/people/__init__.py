"""Several people in a video: tracking, appearance, the performer, left-right swaps, cuts."""
