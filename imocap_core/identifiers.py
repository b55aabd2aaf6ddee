"""Names of actions and videos: parts of file names, whoever wrote them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

NAME = r"[A-Za-z0-9_][A-Za-z0-9_.-]*"
Id = Annotated[str, Field(pattern=f"^{NAME}$")]
