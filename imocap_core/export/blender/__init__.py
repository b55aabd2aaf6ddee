"""FBX and USD by way of Blender, a separate program in an environment of its own."""
