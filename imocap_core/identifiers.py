"""Names of actions and videos: parts of file names, whoever wrote them."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import Field

NAME = r"[A-Za-z0-9_][A-Za-z0-9_.-]*"
Id = Annotated[str, Field(pattern=f"^{NAME}$")]
_RESERVED = re.compile(r"con|prn|aux|nul|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³]", re.IGNORECASE)


def is_portable(part: str) -> bool:
    """Whether every system takes a part of a path: Windows reserves names of devices, with any
    ending, and drops spaces and dots at an end."""
    device = _RESERVED.fullmatch(part.partition(".")[0].rstrip(" "))
    return device is None and not part.endswith((" ", "."))
