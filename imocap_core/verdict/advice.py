"""How a person overrules the synchronisation, in the words of action.yaml."""

from __future__ import annotations


def anchor_advice(video: str, reference: str) -> str:
    """How to tell the program which frames belong together."""
    return (
        "name frames that show the same moment in action.yaml, as in "
        f"`anchors: [{{{reference}: FRAME, {video}: FRAME}}]`"
    )


def forbidden_advice(video: str, first_frame: int, last_frame: int) -> str:
    """How to leave frames out of the matching."""
    span = f"[{first_frame}, {last_frame + 1}]"
    return f"leave these out with `forbidden: [{{video: {video}, frames: {span}}}]`"
