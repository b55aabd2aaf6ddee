"""Real clips of exercises and throws, scored by what a person sees in them."""
