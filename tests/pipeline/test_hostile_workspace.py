"""A working folder from somebody else: nothing outside it is written, nothing runs unasked."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from imocap_core.artifacts import codec
from imocap_core.artifacts.store import Store
from imocap_core.whole_files import appearing

if TYPE_CHECKING:
    from tests.pipeline.conftest import Toy


def test_a_cached_result_with_a_side_file_outside_is_made_again(toy: Toy) -> None:
    assert toy.imocap(["run", "toy"]) == 0
    before, script = toy.digests(), toy.root / "toys" / "gather.py"
    text = script.read_text()
    store = Store(toy.root / "artifacts")
    current = store.load("toy", "evaluate")
    assert current is not None
    for name in ("../../../toys/gather.py", str(script)):
        hostile = replace(current.content, files={name: b"raise SystemExit('planted')"})
        with appearing(store.current("toy", "evaluate")) as stream:
            codec.write(stream, hostile, {})
        store.cached("evaluate", current.key).unlink()
        toy.ran()
        assert toy.imocap(["run", "toy"]) == 0
        assert toy.ran() == ["evaluate"]
        assert script.read_text() == text
        assert toy.digests() == before
