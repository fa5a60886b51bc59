"""Reading a body: a TOML file, typed, with all its errors located."""

from __future__ import annotations

import re
import tomllib
from ast import literal_eval
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, assert_never

from colony.body.kinds import (
    LARGEST,
    NAME,
    Amount,
    AnyAmount,
    Entry,
    FixedArray,
    Flag,
    FreeKeys,
    Interval,
    Kind,
    Many,
    Measure,
    NamedTables,
    OneOf,
    RejectedText,
    TableKind,
    TextKind,
    Whole,
    WordKind,
    entries,
    parse_amount,
    parse_interval,
    parse_quantity,
    unit_hint,
)
from colony.body.model import ROOT, Body
from colony.files import read_file, reason
from colony.text.diagnostics import Diagnostic, error, in_order
from colony.text.source import Source, Span
from colony.text.toml_places import MAX_DOTS, Extent, KeyPlace, all_places
from colony.text.toml_places import Path as Keys
from colony.text.units import NUMBER, readable_unit
from colony.text.wording import counted, did_you_mean, printable, quoted, shortened

MAX_BYTES = 256 * 1024
"""Byte limit of a body."""

LARGEST_OPTION = 1e18
"""Greatest magnitude of a number for a driver, which fits 64 bits."""

_TOML_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")

_TOML_KEYS = re.compile(r"Cannot (?:declare|mutate immutable namespace) (\(.*\))")
_BRACES = re.compile(r"[ \t]*=[ \t]*\{")
_CONTINUED = (
    "an inline table `{ }` cannot be continued by `[...]`: write it as a table, with a header of its own"
)

_BESIDE = "the body of a robot is a file beside its interface; `colony robot new NAME` writes both"


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyFile:
    """A body as it was read, with the places of its keys.

    Attributes:
        source: the text.
        body: the body; None if there are errors.
        diagnostics: the errors.
    """

    source: Source
    body: Body | None
    diagnostics: tuple[Diagnostic, ...]

    def key(self, *keys: str) -> Span:
        """Return the span of a key, or that of the nearest table around it that the text has."""
        return _Places(self.source).key(keys)

    def value(self, *keys: str) -> Span:
        """Return the span of a value, or that of the nearest table around it that the text has."""
        return _Places(self.source).value(keys)


def read_body(path: str | Path) -> BodyFile:
    """Read the body in a TOML file; errors become diagnostics of the result, never exceptions."""
    name = str(path)
    try:
        data = read_file(path, MAX_BYTES)
    except OSError as problem:
        return _unreadable(Source(name, ""), "B001", f"cannot read `{name}`: {reason(problem)}")
    try:
        return body_of_text(data.decode("utf-8-sig"), name)
    except UnicodeDecodeError:
        return _unreadable(Source(name, ""), "B002", f"`{name}` is not TOML: it is not UTF-8 text")


def body_of_text(text: str, name: str) -> BodyFile:
    """Return the body in a TOML text; `name` is for messages."""
    source = Source(name, text)
    if any(line.count(".") > MAX_DOTS for line in text.split("\n")):
        return _unreadable(source, "B002", f"`{name}` has a line with more than {MAX_DOTS} dots")
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        return _unreadable(source, "B002", f"`{name}` is not TOML: it nests too deep")
    except ValueError as invalid:  # also of a number with thousands of digits
        return _not_toml(source, str(invalid))
    reader = _Reader(source)
    body = reader.table(ROOT.type, tables, ())
    if body is not _INVALID and not reader.diagnostics:
        from colony.body.consistency import contradictions

        found = BodyFile(source=source, body=body, diagnostics=())
        reader.diagnostics += contradictions(body, found)
    is_valid = not reader.diagnostics
    return BodyFile(source=source, body=body if is_valid else None, diagnostics=in_order(reader.diagnostics))


def _unreadable(source: Source, code: str, message: str, place: int = 0, hint: str | None = None) -> BodyFile:
    hint = hint or (_BESIDE if code == "B001" else 'write tables such as `[body]`, and `name = "360 mm"`')
    span = Span(source, place, min(place + 1, len(source.text)))
    problem = error(code, span, printable(message), hint)
    return BodyFile(source=source, body=None, diagnostics=(problem,))


def _not_toml(source: Source, message: str) -> BodyFile:
    found, place = _TOML_PLACE.search(message), 0
    if found is not None:
        message = message[: found.start()]
        place = len(source.text.rstrip())
        if found[1] is not None:
            lines = source.text.split("\n")[: int(found[1]) - 1]
            place = min(sum(len(line) + 1 for line in lines) + int(found[2]) - 1, len(source.text))
    text = f"`{source.name}` is not TOML: {message[:1].lower()}{message[1:]}"
    hint = _CONTINUED if _continues_braces(source.text, message) else None
    return _unreadable(source, "B002", text, place, hint)


def _continues_braces(text: str, message: str) -> bool:
    """Return True if tomllib's message is about a header that continues a table in braces."""
    found = _TOML_KEYS.match(message)
    keys = literal_eval(found[1]) if found is not None else ()
    places = all_places(text)
    inline = (place for i in range(1, len(keys) + 1) if (place := places.get(keys[:i])) is not None)
    return any(_BRACES.match(text, place.key.end) for place in inline)


@lru_cache(maxsize=4)
def _places_in(text: str) -> Mapping[Keys, KeyPlace]:
    """Return all places of a text; many findings ask for those of one."""
    return all_places(text)


class _Places:
    """The spans of keys and values of a text."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._found = _places_in(source.text)

    def key(self, keys: Keys) -> Span:
        return self._span(keys, lambda place: place.key)

    def value(self, keys: Keys) -> Span:
        return self._span(keys, lambda place: place.value)

    def _span(self, keys: Keys, part: Any) -> Span:
        found = self._found.get(keys)
        if found is not None:
            return Span(self._source, *part(found))
        inside = [place.key for path, place in self._found.items() if keys and path[: len(keys)] == keys]
        if inside:  # a table without a header of its own, such as `fields` of `fields.scan = ...`
            return Span(self._source, *min(inside))
        return self._span(keys[:-1], lambda place: place.key) if keys else Span(self._source, *Extent(0, 0))


class _Invalid:
    """The value of what could not be read; its error has been reported."""


_INVALID = _Invalid()


class _Reader:
    """Reads values by their kinds, and collects the errors."""

    def __init__(self, source: Source) -> None:
        self._places = _Places(source)
        self.diagnostics: list[Diagnostic] = []

    def read(self, kind: Kind, value: object, keys: Keys) -> Any:
        """Return a value of a kind, `_INVALID` after reporting an error."""
        match kind:
            case Measure():
                return self._measure(kind, value, keys)
            case AnyAmount():
                return self._amount(kind, value, keys)
            case Interval():
                return self._interval(kind, value, keys)
            case Whole():
                return self._whole(kind, value, keys)
            case WordKind():
                return self._word(kind, value, keys)
            case Flag():
                return value if isinstance(value, bool) else self._wrong(keys, value, "true or false")
            case TextKind():
                is_valid = isinstance(value, str) and len(value) <= 200 and re.fullmatch(kind.pattern, value)
                return value if is_valid else self._wrong(keys, value, kind.form)
            case Many():
                return self._many(kind, value, keys)
            case FixedArray():
                return self._row(kind, value, keys)
            case TableKind():
                return self.table(kind.type, value, keys)
            case OneOf():
                return self._one_of(kind, value, keys)
            case NamedTables():
                return self._named(kind, value, keys)
            case FreeKeys():
                raise AssertionError("options are read with their table")
            case _:
                assert_never(kind)

    def _report(self, code: str, span: Span, message: str, hint: str | None = None) -> Any:
        hint = None if hint is None else printable(hint)
        self.diagnostics.append(error(code, span, printable(message), hint))
        return _INVALID

    def _wrong(self, keys: Keys, value: object, expected: str, hint: str | None = None) -> Any:
        message = f"`{'.'.join(keys)}` is {_shown(value)}; expected {expected}"
        return self._report("B006", self._places.value(keys), message, hint)

    def _checked(self, keys: Keys, found: Any) -> Any:
        """Return what was parsed; report a problem of it."""
        if not isinstance(found, RejectedText):
            return found
        message = f"`{'.'.join(keys)}`: {found.message}"
        return self._report(found.code, self._places.value(keys), message, found.hint)

    # --- values ------------------------------------------------------------------------------------

    def _measure(self, kind: Measure, value: object, keys: Keys) -> Any:
        found: Any
        if isinstance(value, str):
            found = self._checked(keys, parse_quantity(value, kind.dimension, kind.example))
        elif isinstance(value, bool) or not isinstance(value, int | float):
            return self._wrong(keys, value, "a text with a number and a unit", f"such as `{kind.example}`")
        elif kind.dimension != NUMBER:
            message = f"`{'.'.join(keys)}`: found {_shown(value)} without a unit"
            hint = unit_hint(kind.dimension, kind.example)
            return self._report("B007", self._places.value(keys), message, hint)
        else:
            if not abs(value) <= LARGEST:  # or NaN
                return self._out_of_bounds(kind, value, keys)
            found = float(value)
        if found is _INVALID or kind.bounds.contain(found):
            return found
        return self._out_of_bounds(kind, value, keys)

    def _out_of_bounds(self, kind: Measure, value: object, keys: Keys) -> Any:
        shown = readable_unit(kind.dimension)
        low, high = (end / float(shown.factor) for end in (kind.bounds.low, kind.bounds.high))
        unit = "" if kind.dimension == NUMBER else f" {shown.text}"
        expected = f"above {low:g}{unit}" if kind.bounds.is_open else f"at least {low:g}{unit}"
        expected += f" and at most {high:g}{unit}" if high < 1e300 else ""
        message = f"`{'.'.join(keys)}` is {_shown(value)}; expected {expected}"
        return self._report("B008", self._places.value(keys), message)

    def _amount(self, kind: AnyAmount, value: object, keys: Keys) -> Any:
        if isinstance(value, str):
            return self._checked(keys, parse_amount(value, kind.example))
        if isinstance(value, bool):
            return Amount(value, NUMBER)
        if not isinstance(value, int | float) or not abs(value) <= LARGEST:
            return self._wrong(keys, value, "a number with its unit, a bool or a name")
        return Amount(float(value), NUMBER)

    def _interval(self, kind: Interval, value: object, keys: Keys) -> Any:
        if not isinstance(value, str):
            return self._wrong(keys, value, "`LOW .. HIGH`", f"such as `{kind.example}`")
        return self._checked(keys, parse_interval(value, kind.dimension, kind.example))

    def _word(self, kind: WordKind, value: object, keys: Keys) -> Any:
        if isinstance(value, str) and value in kind.words:
            return value
        hint = did_you_mean(value, kind.words) if isinstance(value, str) else None
        return self._wrong(keys, value, quoted(kind.words, "or"), hint)

    def _whole(self, kind: Whole, value: object, keys: Keys) -> Any:
        if isinstance(value, bool) or not isinstance(value, int):
            return self._wrong(keys, value, "a whole number")
        if kind.low <= value <= kind.high:
            return value
        message = f"`{'.'.join(keys)}` is {_shown(value)}; expected {kind.low} to {kind.high}"
        return self._report("B008", self._places.value(keys), message)

    def _many(self, kind: Many, value: object, keys: Keys) -> Any:
        if not isinstance(value, list):
            return self._wrong(keys, value, "an array")
        if not kind.least <= len(value) <= kind.most:
            message = (
                f"`{'.'.join(keys)}` has {counted(len(value), 'item')}; expected {kind.least} to {kind.most}"
            )
            return self._report("B008", self._places.value(keys), message)
        return self._all(tuple(self.read(kind.item, item, keys) for item in value))

    def _row(self, kind: FixedArray, value: object, keys: Keys) -> Any:
        if not isinstance(value, list) or len(value) != len(kind.items):
            return self._wrong(keys, value, f"an array of {counted(len(kind.items), 'item')}")
        pairs = zip(kind.items, value, strict=True)
        items = self._all(tuple(self.read(item, part, keys) for item, part in pairs))
        return items if items is _INVALID else kind.type(*items)

    def _all(self, items: tuple[Any, ...]) -> Any:
        return _INVALID if any(item is _INVALID for item in items) else items

    # --- tables ------------------------------------------------------------------------------------

    def table(self, type_: type, value: object, keys: Keys, tag: str | None = None) -> Any:
        """Return an instance of a data class, `_INVALID` after reporting errors; its key `tag` is known."""
        if not isinstance(value, Mapping):
            return self._wrong(keys, value, "a table")
        found: dict[str, Any] = {}
        known = {e.key: e for e in entries(type_)}
        options = next((e for e in known.values() if isinstance(e.kind, FreeKeys)), None)
        unknown = [] if options is not None else [key for key in value if key not in known and key != tag]
        for e in known.values():
            if e is options:
                rest = {k: v for k, v in value.items() if k not in known}
                found[e.attribute] = self._options(rest, keys)
            elif e.key in value:
                found[e.attribute] = self.read(e.kind, value[e.key], (*keys, e.key))
            elif e.is_required:
                if not any(did_you_mean(key, [e.key]) for key in unknown):
                    self._missing(e, keys)  # otherwise it is misspelled, which is reported
                found[e.attribute] = _INVALID
        for key in unknown:
            self._unknown(key, [*([tag] if tag else []), *known], keys)
            found[key] = _INVALID
        return _INVALID if any(v is _INVALID for v in found.values()) else type_(**found)

    def _missing(self, missing: Entry, keys: Keys) -> None:
        where = f"`{'.'.join(keys)}`" if keys else "the body"
        hint = missing.meaning
        if isinstance(missing.kind, Measure):
            hint += f', such as `{missing.key} = "{missing.kind.example}"`'
        elif isinstance(missing.kind, TableKind | OneOf | NamedTables):
            hint += f": write `[{'.'.join((*keys, missing.key))}]`"
        self._report("B004", self._places.key(keys), f"{where} has no `{missing.key}`", hint)

    def _unknown(self, key: str, names: Iterable[str], keys: Keys) -> None:
        known = list(names)
        where = f"`{'.'.join(keys)}`" if keys else "a body"
        hint = did_you_mean(key, known) or (f"expected {quoted(known, 'or')}" if known else "it has no keys")
        path = (*keys, key)
        self._report("B003", self._places.key(path), f"{where} has no key `{shortened(key)}`", hint)

    def _options(self, value: Mapping[str, object], keys: Keys) -> Any:
        found: dict[str, Any] = {}
        for key, option in value.items():
            if isinstance(option, str) or (isinstance(option, int | float) and abs(option) <= LARGEST_OPTION):
                found[key] = option
            else:
                expected = "a text, a number or a bool"
                if isinstance(option, int | float):
                    expected = f"a number up to {LARGEST_OPTION:g}"
                found[key] = self._wrong((*keys, key), option, expected)
        return _INVALID if any(v is _INVALID for v in found.values()) else found

    def _one_of(self, kind: OneOf, value: object, keys: Keys) -> Any:
        if not isinstance(value, Mapping):
            return self._wrong(keys, value, "a table")
        types = dict(kind.types)
        tag = value.get(kind.tag)
        if isinstance(tag, str) and tag in types:
            return self.table(types[tag], value, keys, kind.tag)
        names = quoted(list(types), "or")
        if kind.tag not in value:
            message = f"`{'.'.join(keys)}` has no `{kind.tag}`"
            return self._report("B004", self._places.key(keys), message, f"expected {names}")
        hint = did_you_mean(tag, types) if isinstance(tag, str) else None
        message = f"there is no {kind.tag} {_shown(tag)}"
        return self._report(
            "B005", self._places.value((*keys, kind.tag)), message, hint or f"expected {names}"
        )

    def _named(self, kind: NamedTables, value: object, keys: Keys) -> Any:
        if not isinstance(value, Mapping):
            return self._wrong(keys, value, "a table of tables")
        found = {}
        for name, item in value.items():
            path = (*keys, name)
            if not re.fullmatch(NAME, name):
                message = f"`{shortened(name)}` is no name"
                found[name] = self._report("B006", self._places.key(path), message)
            else:
                found[name] = self.read(kind.item, item, path)
        return _INVALID if any(v is _INVALID for v in found.values()) else found


def _shown(value: object) -> str:
    """Return a value as messages show it."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            text = shortened(value)
            return f'"{text}"'
        case int() | float():
            is_shown = abs(value) < 1e300 or isinstance(
                value, float
            )  # an integer may have thousands of digits
            return shortened(f"{value}") if is_shown else "a number that is too large"
        case list():
            return f"an array of {counted(len(value), 'item')}"
        case Mapping():
            return "a table"
        case _:
            return f"a value of the kind `{type(value).__name__}`"
