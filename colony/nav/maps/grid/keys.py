"""The YAML file of an occupancy grid.

    image: office.png            the image, beside this file or by an absolute path
    resolution: 0.05             the length of a cell's side in meters
    origin: [-10.0, -10.0, 0.0]  x and y in meters of the image's lower left corner, and the yaw in radians
    negate: 0                    1 if white is occupied and black is free
    occupied_thresh: 0.65        at least so dark: occupied
    free_thresh: 0.196           at most so dark: free
    mode: trinary                or scale, or raw (default trinary)
    docks: [[2.0, 1.5, 0.0]]     the poses of robots at charging docks, as the origin's (default none)

The file is read as the events of a YAML parser. No object is made of it, nothing is expanded, and nothing
recurses over it. `docks` is a key of this project, which
map_server ignores. Other keys that map_server does not know are left out, unless they look like one that is
known.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple, TypeVar

from colony.text.diagnostics import Diagnostic, DiagnosticError, error, in_order
from colony.text.source import Source, Span
from colony.text.wording import did_you_mean

MIN_CELL_M, MAX_CELL_M = 0.001, 10.0
MAX_COORDINATE_M = 100_000.0
MAX_DEPTH = 20
MAX_DOCKS = 1000

_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_BOOLEANS = {
    **dict.fromkeys(("true", "yes", "on", "y"), True),
    **dict.fromkeys(("false", "no", "off", "n"), False),
}
_T = TypeVar("_T")


class OccupancyMode(Enum):
    """How the shades of an image become occupancies; the value is the word in the file."""

    TRINARY = "trinary"
    SCALE = "scale"
    RAW = "raw"


@dataclass(frozen=True, slots=True, kw_only=True)
class GridKeys:
    """The content of the YAML file.

    Attributes:
        image: path of the image, as given.
        image_span: the place of that path in the file.
        cell_m: the length of a cell's side in meters.
        origin: x and y of the image's lower left corner in meters, and the yaw in radians.
        negate: True if white is occupied.
        occupied_thresh, free_thresh: bounds of the occupancy, from 0 to 1.
        mode: how shades become occupancies.
        docks: the poses of robots at charging docks: x and y in meters, the yaw in radians.
        docks_span: the place of the docks in the file; None without any.
    """

    image: str
    image_span: Span
    cell_m: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: OccupancyMode
    docks: tuple[tuple[float, float, float], ...] = ()
    docks_span: Span | None = None


class _Word(NamedTuple):
    text: str
    span: Span


class _Entry(NamedTuple):
    """A key and its value: a word, a list of words or of such lists, or None for anything else."""

    key: _Word
    value: _Word | list[_Word | list[_Word]] | None
    span: Span


def read_keys(source: Source) -> GridKeys:
    """Read the YAML file of a grid from its text.

    Raises:
        DiagnosticError: the text is not such a file; with all errors found, in order, each with its location.
    """
    reader = _Reader(source, list(_entries(source)))
    image = reader.value("image", _path)
    cell_m = reader.value("resolution", _cell_m)
    origin = reader.value("origin", _origin)
    negate = reader.value("negate", _flag)
    occupied = reader.value("occupied_thresh", _threshold)
    free = reader.value("free_thresh", _threshold)
    mode = reader.value("mode", _mode, OccupancyMode.TRINARY)
    no_docks: tuple[tuple[float, float, float], ...] = ()
    docks = reader.value("docks", _docks, no_docks)
    reader.check_unknown()
    if free is not None and occupied is not None and free >= occupied:
        span = reader.span("free_thresh")
        reader.problems.append(
            error(
                "M034",
                span,
                f"`free_thresh`: expected less than `occupied_thresh`, {occupied:g}; found {free:g}",
            )
        )
    if (
        image is None or cell_m is None or origin is None or negate is None
        or occupied is None or free is None or mode is None or docks is None or reader.problems
    ):  # fmt: skip
        raise DiagnosticError(in_order(reader.problems))
    return GridKeys(
        image=image,
        image_span=reader.span("image"),
        cell_m=cell_m,
        origin=origin,
        negate=negate,
        occupied_thresh=occupied,
        free_thresh=free,
        mode=mode,
        docks=docks,
        docks_span=reader.span("docks") if docks else None,
    )


# --- the text ------------------------------------------------------------------------------------


def _entries(source: Source) -> Iterator[_Entry]:
    """Yield the entries of the mapping that the file consists of."""
    import yaml

    parser = yaml.parse(source.text, Loader=yaml.SafeLoader)
    try:
        for event in parser:
            if not isinstance(event, yaml.StreamStartEvent | yaml.DocumentStartEvent):
                break
        if not isinstance(event, yaml.MappingStartEvent):
            message = "expected the keys of a map, such as `image: office.png`"
            raise DiagnosticError([error("M032", _span(source, event), message)])
        for event in parser:
            if isinstance(event, yaml.MappingEndEvent):
                return
            if not isinstance(event, yaml.ScalarEvent):
                message = "expected the name of a key; found a list, a mapping or an alias"
                raise DiagnosticError([error("M032", _span(source, event), message)])
            yield _entry(source, event, parser)
    except yaml.MarkedYAMLError as failure:
        mark = failure.problem_mark or failure.context_mark
        at = 0 if mark is None else mark.index
        message = f"the text is not YAML: {failure.problem or failure.context}"
        raise DiagnosticError([error("M032", Span(source, at, at), message)]) from None
    except yaml.reader.ReaderError as failure:
        message = f"the character U+{failure.character:04X} is not allowed in YAML"
        span = Span(source, failure.position, failure.position + 1)
        raise DiagnosticError([error("M032", span, message)]) from None


def _entry(source: Source, key: Any, parser: Iterator[Any]) -> _Entry:
    """Return the entry of a key, whose value comes next."""
    import yaml

    first = next(parser)
    if isinstance(first, yaml.ScalarEvent):
        word = _word(source, first)
        return _Entry(_word(source, key), word, word.span)
    words: list[_Word | list[_Word]] | None = [] if isinstance(first, yaml.SequenceStartEvent) else None
    inner: list[_Word] = []
    depth, event = 0, first
    while True:
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth == 0:
            break
        if depth > MAX_DEPTH:
            message = f"lists and mappings are nested more than {MAX_DEPTH} deep"
            raise DiagnosticError([error("M032", _span(source, event), message)])
        event = next(parser)
        if isinstance(event, yaml.ScalarEvent) and words is not None:
            (words if depth == 1 else inner).append(_word(source, event))
        elif isinstance(event, yaml.SequenceStartEvent) and words is not None and depth == 1:
            words.append(inner := [])
        elif not isinstance(event, yaml.CollectionEndEvent):
            words = None
    return _Entry(_word(source, key), words, _span(source, first).to(_span(source, event)))


def _word(source: Source, event: Any) -> _Word:
    return _Word(str(event.value), _span(source, event))


def _span(source: Source, event: Any) -> Span:
    return Span(source, event.start_mark.index, event.end_mark.index)


# --- the values ----------------------------------------------------------------------------------


class _Reader:
    """Reads the values of keys, and collects what is wrong with them. Mutable."""

    def __init__(self, source: Source, entries: list[_Entry]) -> None:
        self.problems: list[Diagnostic] = []
        self._source = source
        self._entries = entries
        self._known: list[str] = []

    def span(self, key: str) -> Span:
        """Return the place of a key's value."""
        return next(entry.span for entry in self._entries if entry.key.text == key)

    def value(self, key: str, read: Callable[[_Entry], _T], default: _T | None = None) -> _T | None:
        """Return the value of a key; None if it is missing without a default, or malformed."""
        self._known.append(key)
        found = [entry for entry in self._entries if entry.key.text == key]
        for again in found[1:]:
            self.problems.append(error("M035", again.key.span, f"the key `{key}` was already given"))
        if not found:
            if default is None:
                end = len(self._source.text.rstrip())
                span = Span(self._source, end, end)
                self.problems.append(error("M035", span, f"the key `{key}` is missing"))
            return default
        try:
            return read(found[0])
        except ValueError as problem:
            self.problems.append(error("M034", found[0].span, f"`{key}`: {problem}"))
            return None

    def check_unknown(self) -> None:
        """Report keys that were hardly meant as they are."""
        for entry in self._entries:
            if entry.key.text not in self._known:
                hint = did_you_mean(entry.key.text, self._known, cutoff=0.75)
                if hint is not None:
                    message = f"there is no key `{entry.key.text}`"
                    self.problems.append(error("M033", entry.key.span, message, hint))


def _text(entry: _Entry, expected: str) -> str:
    if not isinstance(entry.value, _Word):
        found = "a mapping or an alias" if entry.value is None else "a list"
        raise ValueError(f"expected {expected}; found {found}")
    return entry.value.text


def _number(text: str, expected: str, low: float, high: float) -> float:
    number = float(text) if _NUMBER.fullmatch(text) else math.nan
    if not low <= number <= high:
        raise ValueError(f"expected {expected}; found `{text}`")
    return number


def _path(entry: _Entry) -> str:
    text = _text(entry, "the path of an image")
    if not text:
        raise ValueError("expected the path of an image; found none")
    return text


def _cell_m(entry: _Entry) -> float:
    expected = f"meters from {MIN_CELL_M:g} to {MAX_CELL_M:g}"
    return _number(_text(entry, expected), expected, MIN_CELL_M, MAX_CELL_M)


def _origin(entry: _Entry) -> tuple[float, float, float]:
    return _pose(entry.value)


def _docks(entry: _Entry) -> tuple[tuple[float, float, float], ...]:
    if not isinstance(entry.value, list) or any(isinstance(item, _Word) for item in entry.value):
        raise ValueError("expected a list of poses, [[x, y, yaw], ...], in meters and radians")
    if len(entry.value) > MAX_DOCKS:
        raise ValueError(f"expected at most {MAX_DOCKS:,} docks; found {len(entry.value):,}")
    return tuple(_pose(item) for item in entry.value)


def _pose(value: _Word | Sequence[_Word | list[_Word]] | None) -> tuple[float, float, float]:
    words = [] if value is None or isinstance(value, _Word) else [w for w in value if isinstance(w, _Word)]
    if value is None or len(words) != 3 or len(value) != 3:
        raise ValueError("expected three numbers, [x, y, yaw], in meters and radians")
    meters = f"meters from -{MAX_COORDINATE_M:g} to {MAX_COORDINATE_M:g}"
    x, y = (_number(word.text, meters, -MAX_COORDINATE_M, MAX_COORDINATE_M) for word in words[:2])
    yaw = _number(words[2].text, "a yaw in radians, from -2 pi to 2 pi", -math.tau, math.tau)
    return x, y, yaw


def _flag(entry: _Entry) -> bool:
    text = _text(entry, "0 or 1")
    if text.lower() in _BOOLEANS:
        return _BOOLEANS[text.lower()]
    if not re.fullmatch(r"[-+]?[0-9]{1,9}", text):
        raise ValueError(f"expected 0 or 1; found `{text}`")
    return int(text) != 0


def _threshold(entry: _Entry) -> float:
    return _number(_text(entry, "a number from 0 to 1"), "a number from 0 to 1", 0.0, 1.0)


def _mode(entry: _Entry) -> OccupancyMode:
    text = _text(entry, "trinary, scale or raw")
    words = [mode.value for mode in OccupancyMode]
    if text.lower() not in words:
        hint = did_you_mean(text, words)
        raise ValueError(f"expected trinary, scale or raw; found `{text}`" + (f"; {hint}" if hint else ""))
    return OccupancyMode(text.lower())
