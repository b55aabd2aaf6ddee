"""Settings shared by the whole suite."""

from hypothesis import settings
from jaxtyping import install_import_hook

# Rooms whose annotations (types, and shapes of arrays) are checked at every call in the tests.
CHECKED: tuple[str, ...] = ("imocap_core.alignment",)

install_import_hook(CHECKED, "beartype.beartype")

# No deadline: the suite must not fail on a busy machine. Derandomised: a failure is the same
# failure on every machine.
settings.register_profile("imocap", deadline=None, derandomize=True, max_examples=30)
settings.load_profile("imocap")
