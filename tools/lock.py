"""Write locked.txt: every package of constraints.txt with the hashes of its files.

    python -m pip install uv && python tools/lock.py

uv (https://docs.astral.sh/uv) resolves for every platform and Python from 3.11 on. What comes with
torch alone (its CUDA libraries) is not in the file: torch has builds of one version with different
content, of which people choose (for their graphics card, or for none).
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / "locked.txt"
APART = re.compile(r"(torch|triton|nvidia-[a-z0-9-]+|cuda-[a-z0-9-]+)==|.*'pypy'$")
HEAD = """\
# The packages of constraints.txt with the hashes of their files, for Linux, macOS and Windows and
# Python 3.11 and newer; `make` installs from it. Made by `python tools/lock.py`; don't edit.
# torch and the libraries that come with it are apart: constraints.txt pins its version.
"""


def locked_text(compiled: str) -> str:
    """The file's text from what uv compiled: without comments, and without torch."""
    blocks = re.split(r"\n(?=\S)", re.sub(r"(?m)^\s*#.*\n", "", compiled).strip())
    locked = [block for block in blocks if not APART.match(block.splitlines()[0].rstrip("\\ "))]
    return HEAD + "".join(f"{block}\n" for block in locked)


def main() -> None:
    """Resolve, and write the file."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "compiled.txt"
        line = [sys.executable, "-m", "uv", "pip", "compile", "--quiet", "--universal"]
        line += ["--generate-hashes", "--python-version", "3.11", "--extra", "dev"]
        line += ["--no-annotate", "--no-header", "--no-emit-index-url"]
        line += ["--constraints", "constraints.txt", "--output-file", str(out), "pyproject.toml"]
        subprocess.run(line, cwd=ROOT, check=True)
        FILE.write_text(locked_text(out.read_text()))


if __name__ == "__main__":
    main()
