"""Scripts that Blender runs; they import nothing of the project."""
