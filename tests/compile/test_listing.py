"""Whatever changes in lowered code changes its listing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import pytest

from tests.compile.listing import listing
from tests.compile.test_whole_code import CASES
from tests.programs import lowered

UNLISTED = {
    "kinds",
    "sensors",
    "span",
    "loss_aware_guard",
    "loss_aware_exclusive",
    "unsimplified",
    "has_several_paths",
}
"""Fields that have a test below, that say where something stands, or what a view takes for `guard`."""

PARTS = {"ops", "cells", "python", "actuators", "contracts", "clients", "limits", "reads"}


def others(value: object) -> Iterator[Any]:
    """Yield values in place of one: another number or name, or one element less."""
    match value:
        case bool():
            yield not value
        case int() | float():
            yield value - 1 if value == value else 0.0
        case str():
            yield "<=" if value == ">=" else ">=" if value == "<=" else value + "_"
        case tuple() if value:
            yield value[1:]


def changes(part: Any) -> Iterator[Any]:
    """Yield a part of the code with each of its fields changed, those of its own parts included."""
    for field in fields(part):
        value = getattr(part, field.name)
        if field.name in PARTS:
            for at, one in enumerate(value):
                for other in changes(one):
                    yield replace(part, **{field.name: (*value[:at], other, *value[at + 1 :])})
        elif field.name not in UNLISTED:
            for other in others(value):
                yield replace(part, **{field.name: other})
        for key in value if isinstance(value, dict) else ():
            yield replace(part, **{field.name: {k: v for k, v in value.items() if k != key}})


@pytest.mark.parametrize(
    "path", [path for path in CASES if path.stem not in ("arithmetic", "nested", "arrays")]
)
def test_every_change_is_seen(path: Any) -> None:
    code = lowered(path.read_text())
    text = listing(code)
    assert all(listing(changed) != text for changed in changes(code))
    for at, kind in enumerate(code.kinds):
        other = next(one for one in type(kind) if one is not kind)
        assert listing(replace(code, kinds=(*code.kinds[:at], other, *code.kinds[at + 1 :]))) != text
