"""A stage's key: a digest of everything that its result depends on, and of nothing else.

Its code, the values of its parameters, the seed, the decoded content of its inputs, and of the
action what it declares to read. Never file times, absolute paths or compressed bytes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType
from typing import Any

from imocap_core.pipeline.action import DETECT, Action, placed
from imocap_core.pipeline.graph import Pipeline, RunSettings
from imocap_core.pipeline.source import closure, content_digest
from imocap_core.pipeline.stage import Read, Recipe, canonical

OPTIONAL = {"imocap_core.io.colmap": "pycolmap"}  # module -> library that it can do without
FIELDS = {"detections": "keypoints", "videos": "video", "sound": "video", "initial": "initial"}


def recipe(
    pipeline: Pipeline,
    stage: str,
    action: Action,
    settings: RunSettings,
    inputs: Mapping[str, str],
    absent: Mapping[str, str] = MappingProxyType({}),
) -> Recipe:
    """The recipe of a stage now.

    Args:
        inputs: the content digests of its input artifacts.
        absent: what to take as the digest of a read (by its name in `reads`) where its file does
            not exist; WorkFailed for any other that does not.
    """
    spec = pipeline.stages[stage]
    code = closure(pipeline.script(stage))
    for library in sorted({name for module, name in OPTIONAL.items() if module in code}):
        try:  # it may be installed later
            code[f"library {library}"] = version(library)
        except PackageNotFoundError:
            code[f"library {library}"] = "is not installed"
    reads = {}
    for kind in spec.reads:
        for name, value in _reads(kind, action):
            gone = isinstance(value, Path) and name in absent and not value.exists()
            given = absent[name] if gone else value
            reads[name] = content_digest(given) if isinstance(given, Path) else given
    return Recipe(
        code=code,
        params=settings.of(spec.params),
        seed=settings.seed,
        inputs=dict(inputs),
        reads=reads,
    )


def read_files(pipeline: Pipeline, stage: str, action: Action) -> dict[str, Path]:
    """The files and folders of the action that a stage reads, by their names in a recipe."""
    reads = (pair for kind in pipeline.stages[stage].reads for pair in _reads(kind, action))
    return {name: value for name, value in reads if isinstance(value, Path)}


def differences(before: Mapping[str, str], now: Recipe) -> list[str]:
    """In words, how a recipe differs from the stored one (`before`, a provenance)."""
    lines = value_differences(before, now)
    code = json.loads(before.get("code", "null")) or {}
    return [*lines, *_changed_leaves("code", code, now.code)]


def value_differences(before: Mapping[str, str], now: Recipe) -> list[str]:
    """As `differences`, apart from the code: what has another input, file or parameter."""
    old = {name: json.loads(before.get(name, "null")) for name in asdict(now)}
    lines: list[str] = []
    if old["format"] != now.format:
        lines.append("the way artifacts are made has changed")
    if old["seed"] != now.seed:
        lines.append(f"seed: {old['seed']} -> {now.seed}")
    flat_old, flat_now = _flat(old["params"] or {}), _flat(now.params)
    lines += [
        f"{name}: {flat_old.get(name, 'absent')} -> {flat_now.get(name, 'absent')}"
        for name in sorted({*flat_old, *flat_now})
        if flat_old.get(name, "absent") != flat_now.get(name, "absent")
    ]
    lines += _changed_leaves("input", old["inputs"] or {}, now.inputs)
    return lines + _changed_leaves("read", old["reads"] or {}, now.reads)


def _changed_leaves(title: str, former: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    changed = [n for n in sorted({*former, *now}) if former.get(n) != now.get(n)]
    how = {n: "has changed" if n in former and n in now else "is gone" for n in changed}
    how |= dict.fromkeys([n for n in changed if n not in former], "is new")
    return [f"{title}: {name} {how[name]}" for name in changed]


def _reads(kind: Read, action: Action) -> Iterator[tuple[str, str | Path]]:
    """What a kind of read stands for: each by a name, a digest or the file that is read."""
    if kind == "declarations":
        for video in placed(action.videos):
            text = canonical(video.model_dump(mode="json", by_alias=True))
            yield f"declarations {video.id}", hashlib.sha256(text.encode()).hexdigest()
        order = canonical([video.id for video in action.videos])
        yield "declarations (order)", hashlib.sha256(order.encode()).hexdigest()
        return
    if kind == "hints":
        for name, entries in (("anchors", action.anchors), ("forbidden", action.forbidden)):
            text = canonical([entry.model_dump(mode="json") for entry in entries])
            yield f"hints {name}", hashlib.sha256(text.encode()).hexdigest()
        mirrored = canonical({video.id: video.mirrored for video in action.videos})
        yield "hints mirrored", hashlib.sha256(mirrored.encode()).hexdigest()
        return
    if kind == "truth":
        for name in action.truth_files:
            yield f"truth {name}", action.folder / name
        return
    if kind == "event":
        if action.event is not None:
            yield "event", str(action.event).lower()
        return
    if kind == "sound" and not action.event:
        return
    field = FIELDS[kind]
    for video in action.videos:
        given = getattr(video, field)
        path = action.detected.get(video.id) if given == DETECT else given
        if path is not None:
            yield f"{kind} {video.id}", action.folder / path


def _flat(groups: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    return {f"{group}.{name}": v for group, values in groups.items() for name, v in values.items()}
