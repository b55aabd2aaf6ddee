"""`make baseline`: the baseline's values from a fresh run, and what moved.

Metrics, directions and tolerances stay as they were written by hand.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

from tests.regression.comparison import (
    BASELINE,
    Scores,
    compare,
    document,
    lost,
    parse,
    table,
    watched,
)
from tests.regression.measure import DATA_VARIABLE, MADE, REAL, real_data, run_pipeline


def main() -> None:
    old = parse(BASELINE.read_text(encoding="utf-8"))
    scores = fresh_scores()
    values = {**old.values, **watched(scores, old.metrics)}
    BASELINE.write_text(document(replace(old, values=values)), encoding="utf-8")
    for action in scores:
        if action in old.values:
            verdicts = compare(old, action, scores[action])
            print(f"\n{table(verdicts)}\n{len(lost(verdicts))} beyond the old tolerance")
    print(f"\nwrote {BASELINE.name}. When a number moved, CHANGELOG.md must say which and why.")


def fresh_scores() -> Scores:
    """Both actions, run in a folder of their own."""
    scores = {}
    with tempfile.TemporaryDirectory(prefix="imocap-baseline.") as folder:
        print(f"running {MADE}", flush=True)
        scores[MADE] = run_pipeline(Path(folder), MADE).summary()
        real = real_data()
        if real is None:
            print(f"{REAL} is not here ({DATA_VARIABLE} names where): its old values stay")
        else:
            print(f"running {REAL}", flush=True)
            scores[REAL] = run_pipeline(Path(folder), real).summary()
    return scores


if __name__ == "__main__":
    main()
