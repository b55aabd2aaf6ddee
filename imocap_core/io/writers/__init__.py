"""Writers of what other programs read, a format a file."""
