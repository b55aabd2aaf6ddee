"""Read all of an HDF5 file, and do nothing with it: python -m imocap_core.io.hdf5_trial FILE

HDF5's library has no defence of its own: from a damaged file it may never come back, or end the
process. So a file is read here first, in a process that can be ended (`hdf5.must_come_back`).
"""

from __future__ import annotations

import sys
from contextlib import suppress
from importlib import import_module
from typing import Any

from imocap_core.limits import MAX_UNPACKED_BYTES

DEEPEST = 16  # groups within groups; a damaged file may have itself as a part


def read_all(group: Any, depth: int = 0) -> None:
    """Every attribute and every dataset of reasonable size that lies in the file itself."""
    hard = import_module("h5py").HardLink
    read_attributes(group)
    for name in group:
        with suppress(Exception):  # each part is read, whatever is wrong with another
            if not isinstance(group.get(name, getlink=True), hard):
                continue
            member = group[name]
            if hasattr(member, "keys"):
                if depth < DEEPEST:
                    read_all(member, depth + 1)
                continue
            read_attributes(member)
            if not (member.is_virtual or member.external or member.nbytes > MAX_UNPACKED_BYTES):
                member[()]


def read_attributes(member: Any) -> None:
    """All attributes of a group or a dataset."""
    with suppress(Exception):
        list(member.attrs.items())


if __name__ == "__main__":
    with import_module("h5py").File(sys.argv[1], "r") as root:
        read_all(root)
