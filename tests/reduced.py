"""What a pickle calls when it is read carelessly."""

from pathlib import Path
from typing import Any


class Reduced:
    """Pickles as a call of a function with arguments and a state of one's choice."""

    def __init__(self, *reduced: Any) -> None:
        self.reduced = reduced

    def __reduce__(self) -> tuple[Any, ...]:
        return self.reduced


def touching(file: Path) -> Reduced:
    """Makes a file when it is unpickled."""
    return Reduced(Path.touch, (file,))
