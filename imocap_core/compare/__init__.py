"""What performances of an action share, how they differ, and two performers."""
