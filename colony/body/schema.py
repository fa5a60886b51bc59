"""The JSON schema of bodies, with which editors complete and check them as they are written.

It is made from the data classes, and stands in `robots/body.schema.json`:
`python -m colony.body.schema > robots/body.schema.json`. What a schema cannot say (dimensions of units,
bounds of quantities, contradictions) only `colony robot check` finds.
"""

from __future__ import annotations

import json
from typing import Any, assert_never

from colony.body.kinds import (
    MAX_LENGTH,
    NAME,
    NUMBER_PATTERN,
    AnyAmount,
    FixedArray,
    Flag,
    FreeKeys,
    Interval,
    Kind,
    Many,
    Measure,
    NamedTables,
    OneOf,
    TableKind,
    TextKind,
    Whole,
    WordKind,
    entries,
)
from colony.body.model import ROOT
from colony.text.units import NUMBER, common_units

Schema = dict[str, Any]

_UNIT = r"\S*[A-Za-z]\S*"


def body_schema() -> Schema:
    """Return the JSON schema of a body."""
    head = {"$schema": "http://json-schema.org/draft-07/schema#", "title": "The body of a robot"}
    return head | _table(ROOT.type, None)


def _schema(kind: Kind) -> Schema:
    match kind:
        case Measure():
            return _measure(kind)
        case AnyAmount():
            return {"type": ["string", "number", "boolean"], "examples": [kind.example]}
        case Interval():
            end = rf"\s*{NUMBER_PATTERN}\s*"
            return _text(rf"{end}(?:{_UNIT})?\s*\.\.{end}{_UNIT}\s*") | {"examples": [kind.example]}
        case Whole():
            return {"type": "integer", "minimum": kind.low, "maximum": kind.high}
        case WordKind():
            return {"enum": list(kind.words)}
        case Flag():
            return {"type": "boolean"}
        case TextKind():
            return _text(kind.pattern) | {"maxLength": 200}
        case Many():
            items = _schema(kind.item)
            return {"type": "array", "items": items, "minItems": kind.least, "maxItems": kind.most}
        case FixedArray():
            count = len(kind.items)
            places = [_schema(item) for item in kind.items]
            return {"type": "array", "items": places, "minItems": count, "maxItems": count}
        case TableKind():
            return _table(kind.type, None)
        case OneOf():
            return {
                "type": "object",
                "required": [kind.tag],
                "properties": {kind.tag: {"enum": [name for name, _ in kind.types]}},
                "allOf": [
                    {"if": _is(kind.tag, name), "then": _table(type_, (kind.tag, name))}
                    for name, type_ in kind.types
                ],
            }
        case NamedTables():
            item = _schema(kind.item)
            return {"type": "object", "propertyNames": {"pattern": f"^{NAME}$"}, "additionalProperties": item}
        case FreeKeys():
            return {"type": ["string", "number", "boolean"]}
        case _:
            assert_never(kind)


def _measure(kind: Measure) -> Schema:
    number = rf"\s*{NUMBER_PATTERN}\s*"
    units = ", ".join(common_units(kind.dimension))
    if kind.dimension != NUMBER:
        return _text(number + _UNIT + r"\s*") | {"examples": [kind.example], "description": f"in {units}"}
    text = _text(number + r"\S*\s*")
    return {"anyOf": [{"type": "number"}, text], "examples": [kind.example]}


def _text(pattern: str) -> Schema:
    return {"type": "string", "pattern": f"^(?:{pattern})$", "maxLength": MAX_LENGTH}


def _is(tag: str, name: str) -> Schema:
    return {"properties": {tag: {"const": name}}, "required": [tag]}


def _table(type_: type, tag: tuple[str, str] | None) -> Schema:
    """Return the schema of a table; `tag` is a key that it has besides, and its value."""
    schema: Schema = {"type": "object"}
    if type_.__doc__ is not None:
        schema["description"] = type_.__doc__.partition("\n")[0]
    properties: Schema = {} if tag is None else {tag[0]: {"const": tag[1]}}
    required: list[str] = []
    schema["additionalProperties"] = False
    for e in entries(type_):
        if isinstance(e.kind, FreeKeys):
            schema["additionalProperties"] = _schema(e.kind)
            continue
        own = _schema(e.kind)
        described = (
            f"{e.meaning}, {own['description']}"
            if isinstance(e.kind, Measure) and "description" in own
            else e.meaning
        )
        properties[e.key] = own | {"description": described}
        required += [e.key] if e.is_required else []
    return schema | {"properties": properties, "required": required}


if __name__ == "__main__":
    print(json.dumps(body_schema(), indent=2))
