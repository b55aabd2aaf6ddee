"""Known vulnerabilities of the packages in locked.txt, by pip-audit:  make audit.

Exit code 0: none known; 1: some are; 2: the package index did not tell of every package.
"""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any


def outcome(dependencies: list[dict[str, Any]]) -> tuple[list[str], int]:
    """Lines for the user, and the exit code."""
    lines = [
        f"{package['name']} {package['version']}: {fault['id']}, mended in "
        f"{', '.join(fault['fix_versions']) or 'no version yet'}"
        for package in dependencies
        for fault in package.get("vulns", [])
    ]
    skipped = [package["name"] for package in dependencies if "skip_reason" in package]
    audited = len(dependencies) - len(skipped)
    if lines:
        return lines, 1
    if skipped or not dependencies:
        return [
            f"imocap: only {audited} of {len(dependencies)} packages could be audited; the package "
            f"index that is reached from here does not tell of vulnerabilities in the others"
        ], 2
    return [f"imocap: no vulnerability is known of {audited} packages"], 0


def main() -> int:
    """Run pip-audit (the first argument) and say what it found."""
    line = [sys.argv[1], "--no-deps", "--disable-pip", "-r", "locked.txt", "-f", "json"]
    done = subprocess.run([*line, "--progress-spinner", "off"], capture_output=True, text=True)
    try:
        dependencies = json.loads(done.stdout)["dependencies"]
    except (ValueError, KeyError):
        reason = (done.stderr.strip().splitlines() or ["no answer"])[-1]
        print(f"imocap: the audit needs a package index that answers: {reason}")
        return 2
    lines, code = outcome(dependencies)
    print("\n".join(lines))
    return code


if __name__ == "__main__":
    raise SystemExit(main())
