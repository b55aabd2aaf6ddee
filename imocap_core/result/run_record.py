"""Which run a result is of: the seed, the parameters, and the digest of every stage's result."""

from __future__ import annotations

import json
from typing import Any

from imocap_core.result.artifacts import STAGE_OF, Artifacts

RECIPE = ("seed", "params")


def run_record(artifacts: Artifacts) -> dict[str, Any]:
    """As plain data: `seed`, `params` (group -> name -> value) and `stages` (stage -> key of its
    recipe and digest of its content), of the stages whose results were stored by a run."""
    record: dict[str, Any] = {"seed": None, "params": {}, "stages": {}}
    for stage in STAGE_OF.values():
        stored = artifacts.stored(stage) if stage != "evaluate" else None
        if stored is None:
            continue
        record["stages"][stage] = {"key": stored.key, "digest": stored.digest}
        seed, params = (json.loads(stored.content.provenance.get(name, "null")) for name in RECIPE)
        record["seed"] = seed if record["seed"] is None else record["seed"]
        record["params"] |= params or {}
    return record
