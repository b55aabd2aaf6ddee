"""Settings shared by the whole suite."""

from hypothesis import settings

# No deadline: the suite must not fail on a busy machine. Derandomised: a failure is the same
# failure on every machine.
settings.register_profile("imocap", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("imocap")
