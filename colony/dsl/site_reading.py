"""Params of a site: the values that a TOML file, or a caller, sets in place of those in the program's text.

    cruising = "250 mm/s"

    [wander.avoid]
    clearance = "0.7 m"

A key is the name of a param as the program's main file writes it, with tables or dots; a value is a text in
the language, or a number or a bool of TOML.
"""

from __future__ import annotations

import errno
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

from colony.dsl.files import UnreadableFileError, decode
from colony.dsl.site import SiteParams, SiteValue
from colony.files import read_file, reason, size_text
from colony.ir.site import Site
from colony.text.diagnostics import Diagnostic, error, headline
from colony.text.source import Source, Span
from colony.text.toml_places import MAX_DOTS, places

MAX_BYTES = 64 * 1024
"""Byte limit of a file of params: it is far more than people write, and is read at once."""

MAX_TEXT = 1000
"""Maximum number of characters of a value."""

_TOML_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")


def read_params(path: str | Path) -> SiteParams:
    """Read the params in a TOML file; errors become diagnostics of the result, never exceptions."""
    name = str(path)
    try:
        return params_from_toml(decode(read_file(path, MAX_BYTES), name))
    except OSError as problem:
        why = reason(problem)
        if problem.errno == errno.EFBIG:
            why = f"it is larger than {size_text(MAX_BYTES)}"
        return _unusable(name, error("E701", _start(Source(name, "")), f"cannot read `{name}`: {why}"))
    except UnreadableFileError as problem:
        span = problem.span or _start(Source(name, ""))
        return _unusable(name, error("E702", span, f"`{name}` is not TOML: {problem.message}", problem.hint))


def params_from_toml(source: Source) -> SiteParams:
    """Return the params in a TOML text."""
    start = 0
    for line in source.text.split("\n"):
        if line.count(".") > MAX_DOTS:
            message = f"`{source.name}` has a line with more than {MAX_DOTS} dots"
            problem = error("E702", Span(source, start, start + 1), message, "names have few parts")
            return _unusable(source.name, problem)
        start += len(line) + 1
    try:
        tables = tomllib.loads(source.text)
    except RecursionError:
        problem = error("E702", _start(source), f"`{source.name}` is not TOML: it nests too deep")
        return _unusable(source.name, problem)
    except ValueError as invalid:  # also of a number with thousands of digits
        return _unusable(source.name, _not_toml(source, str(invalid)))
    found, values, diagnostics = places(source.text), list[SiteValue](), list[Diagnostic]()
    for path, value in _leaves(tables):
        place = found.get(path)
        key = _start(source) if place is None else Span(source, *place.key)
        where = key if place is None else Span(source, *place.value)
        text, problem_text = _text_of(value)
        if problem_text is not None:
            hint = 'write a text in the language, such as "250 mm/s", a number, or true or false'
            diagnostics.append(error("E704", where, f"`{'.'.join(path)}` is {problem_text}", hint))
        values.append(
            SiteValue(name=".".join(path), text=text, is_text=isinstance(value, str), key=key, place=where)
        )
    return SiteParams(file=source.name, values=tuple(values), diagnostics=tuple(diagnostics))


def params_from_values(values: Mapping[str, object], name: str) -> SiteParams:
    """Return the params of a mapping that has what a TOML file has, as messages show it in `name`."""
    lines: list[str] = []
    spans: list[tuple[str, object, tuple[int, int, int, int]]] = []
    offset = 0
    for path, value in _leaves(values):
        key, shown = ".".join(path), repr(value)
        line = f"{key} = {shown}"
        spans.append((key, value, (offset, offset + len(key), offset + len(key) + 3, offset + len(line))))
        lines.append(line)
        offset += len(line) + 1
    source = Source(name, "\n".join(lines))
    found, diagnostics = list[SiteValue](), list[Diagnostic]()
    for key, value, (start, end, value_start, value_end) in spans:
        where = Span(source, value_start, value_end)
        text, problem = _text_of(value)
        if problem is not None:
            hint = 'give a text in the language, such as "250 mm/s", a number, or True or False'
            diagnostics.append(error("E704", where, f"`{key}` is {problem}", hint))
        is_text, key_span = isinstance(value, str), Span(source, start, end)
        found.append(SiteValue(name=key, text=text, is_text=is_text, key=key_span, place=where))
    return SiteParams(file=name, values=tuple(found), diagnostics=tuple(diagnostics))


class SavedParamsError(Exception):
    """A file of params cannot take values; the message says why."""


def saved_params(path: Path, values: Mapping[str, str]) -> str:
    """Return the text of a file of params, which need not exist, with these values by full name.

    Everything else stays as it is; values that it did not have come before its first table.

    Raises:
        OSError: the file cannot be read.
        SavedParamsError: it is not a file of params.
    """
    text = ""
    if path.exists():
        found = read_params(path)
        if found.diagnostics:
            raise SavedParamsError(headline(found.diagnostics[0]))
        given = {value.name: value.place for value in found.values}
        text = decode(read_file(path, MAX_BYTES), str(path)).text  # the one that the places count in
        for name, place in sorted(given.items(), key=lambda item: -item[1].start):
            if name in values:
                text = f'{text[: place.start]}"{values[name]}"{text[place.end :]}'
        values = {name: value for name, value in values.items() if name not in given}
    table = re.search(r"^[ \t]*\[", text, re.MULTILINE)
    at = len(text) if table is None else table.start()
    before = text[:at] + ("\n" if text[:at] and not text[:at].endswith("\n") else "")
    added = "".join(f'{name} = "{value}"\n' for name, value in values.items())
    saved = before + added + ("\n" if added and text[at:] else "") + text[at:]
    problems = params_from_toml(Source(str(path), saved)).diagnostics
    if problems:  # such as a key beside a table of the same name
        raise SavedParamsError(headline(problems[0]))
    return saved


def params_of(site: Site | None) -> SiteParams | None:
    """Return the params that a recording or a compiled program holds."""
    return None if site is None else params_from_values(dict(site.values), site.file)


def _leaves(tables: Mapping[str, object]) -> Iterator[tuple[tuple[str, ...], object]]:
    """Yield every value that is no table, with its path; in order, and however deep."""
    stack: list[Iterator[tuple[tuple[str, ...], object]]] = [
        iter([((str(key),), value) for key, value in tables.items()])
    ]
    while stack:
        found = next(stack[-1], None)
        if found is None:
            stack.pop()
            continue
        path, value = found
        if isinstance(value, Mapping):
            stack.append(iter([((*path, str(key)), inner) for key, inner in value.items()]))
        else:
            yield path, value


def _text_of(value: object) -> tuple[str | None, str | None]:
    """Return a value as the language writes it, or what is wrong with it."""
    match value:
        case bool():
            return ("true" if value else "false"), None
        case int() if abs(value) < 10**MAX_TEXT:
            return str(value), None
        case float() if abs(value) < float("inf"):
            return repr(value), None
        case int() | float():
            return None, "a number that is infinite, no number, or too large"
        case str() if len(value) > MAX_TEXT:
            return None, f"a text of {len(value)} characters; at most {MAX_TEXT} are allowed"
        case str():
            return value, None
        case list():
            return None, "an array; expected one value"
        case _:
            return None, f"a value of the kind `{type(value).__name__}`"


def _not_toml(source: Source, message: str) -> Diagnostic:
    """Return the error of a text that is not TOML, at the place that the message gives."""
    found, place = _TOML_PLACE.search(message), 0
    if found is not None:
        message = message[: found.start()]
        place = len(source.text.rstrip())
        if found[1] is not None:
            lines = source.text.split("\n")[: int(found[1]) - 1]
            place = min(sum(len(line) + 1 for line in lines) + int(found[2]) - 1, len(source.text))
    message = message[:1].lower() + message[1:]
    hint = 'write `name = "250 mm/s"`, and tables such as `[wander.avoid]`'
    return error("E702", Span(source, place, place + 1), f"`{source.name}` is not TOML: {message}", hint)


def _start(source: Source) -> Span:
    return Span(source, 0, 0)


def _unusable(name: str, problem: Diagnostic) -> SiteParams:
    return SiteParams(file=name, values=(), diagnostics=(problem,))
