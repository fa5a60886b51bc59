"""The lines of a StickRep file that are neither rings nor rows; `reader.py` describes them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, get_args

from colony.nav.maps.stickrep import fields
from colony.nav.maps.stickrep.fields import LENGTH_UNITS, LineWord, Problems
from colony.nav.maps.stickrep.model import LightOffsets, Travel
from colony.text.source import Source, Span
from colony.text.wording import did_you_mean

_T = TypeVar("_T")


class Header:
    """The header, as read so far.

    The lengths and nodes in it (`start`, `tolerance`, `links`, `elevators`, `holes`, `docks`) are kept as
    words, because the unit and the rings may come later.
    """

    def __init__(self, problems: Problems, source: Source) -> None:
        self.problems = problems
        self.source = source
        self.seen: dict[str, Span] = {}
        self.name: str | None = None
        self.floor = ""
        self.unit = "inch"
        self.light_offsets: LightOffsets = "incremental"
        self.travel: Travel = "either"
        self.tolerance: LineWord | None = None
        self.start: tuple[LineWord, ...] | None = None
        self.links: list[tuple[LineWord, LineWord]] = []
        self.elevators: list[tuple[LineWord, LineWord, LineWord]] = []
        self.holes: list[tuple[LineWord, ...]] = []
        self.docks: list[tuple[LineWord, ...]] = []
        self._unique: dict[str, tuple[str, Callable[[list[LineWord]], None]]] = {
            "map": ("map NAME", self._map),
            "floor": ("floor NAME", self._floor),
            "start": ("start X Y HEADING", self._start),
            "unit": ("unit NAME", self._unit),
            "lights": ("lights CONVENTION", self._lights),
            "closure": ("closure LENGTH", self._closure),
            "travel": ("travel WAY", self._travel),
        }
        self._repeatable: dict[str, tuple[str, Callable[[list[LineWord]], None]]] = {
            "link": ("link PLACE PLACE", self._link),
            "elevator": ("elevator NODE FILE NODE", self._elevator),
            "hole": ("hole X Y X Y", self._hole),
            "dock": ("dock X Y HEADING", self._dock),
        }

    @property
    def keywords(self) -> tuple[str, ...]:
        """The first words of all kinds of header lines."""
        return (*self._unique, *self._repeatable)

    def read_line(self, words: list[LineWord]) -> bool:
        """Read a line if it belongs to the header, and return True; report an unknown line."""
        key = words[0]
        if key.text == "ring" or key.looks_like_number:
            return False
        if key.text in self._repeatable:
            line = " ".join(word.text for word in words)
            if self._is_first(line, key.span, f"each `{key.text}` line once"):
                self._read(words, *self._repeatable[key.text])
            return True
        if key.text not in self._unique:
            close = did_you_mean(key.text, ("stickrep", "ring", *self.keywords))
            hint = close or "header lines are: " + ", ".join(self.keywords)
            message = f"expected a header line, `ring` or a row that begins with an angle; found {key.shown}"
            self.problems.report("M004", key.span, message, hint)
            return False  # perhaps a row: its ring is not checked further
        if self._is_first(key.text, key.span, f"one `{key.text}` line"):
            self._read(words, *self._unique[key.text])
        return True

    def _read(self, words: list[LineWord], usage: str, handle: Callable[[list[LineWord]], None]) -> None:
        """Handle the values of a line if their number matches its usage."""
        values = fields.values(self.problems, words, usage)
        if values:
            handle(values)

    def _is_first(self, key: str, span: Span, expected: str) -> bool:
        if key not in self.seen:
            self.seen[key] = span
            return True
        line, _ = self.source.position(self.seen[key].start)
        message = f"expected {expected}; found a second one, the first is line {line}"
        self.problems.report("M005", span, message, "remove one of the two lines")
        return False

    def _map(self, values: list[LineWord]) -> None:
        self.name = fields.name(self.problems, values[0], "the map's name")

    def _floor(self, values: list[LineWord]) -> None:
        self.floor = fields.name(self.problems, values[0], "the floor's name") or ""

    def _start(self, values: list[LineWord]) -> None:
        self.start = tuple(values)

    def _closure(self, values: list[LineWord]) -> None:
        self.tolerance = values[0]

    def _unit(self, values: list[LineWord]) -> None:
        if values[0].text in LENGTH_UNITS:
            self.unit = values[0].text
            return
        message = f"expected a unit of length, {', '.join(LENGTH_UNITS)}; found {values[0].shown}"
        self.problems.report("M007", values[0].span, message)

    def _lights(self, values: list[LineWord]) -> None:
        hint = "offsets count from the light before (incremental), or all from the node (cumulative)"
        self.light_offsets = self._choice(get_args(LightOffsets), values[0], hint) or self.light_offsets

    def _travel(self, values: list[LineWord]) -> None:
        hint = "paths follow the rings both ways (either), or only as these are traced (wall-on-left)"
        self.travel = self._choice(get_args(Travel), values[0], hint) or self.travel

    def _choice(self, choices: tuple[_T, ...], word: LineWord, hint: str) -> _T | None:
        """Return the choice that equals the word; None, with an error, if there is none."""
        for choice in choices:
            if word.text == choice:
                return choice
        message = f"expected {' or '.join(map(str, choices))}; found {word.shown}"
        self.problems.report("M007", word.span, message, hint)
        return None

    def _link(self, values: list[LineWord]) -> None:
        self.links.append((values[0], values[1]))

    def _hole(self, values: list[LineWord]) -> None:
        self.holes.append(tuple(values))

    def _dock(self, values: list[LineWord]) -> None:
        self.docks.append(tuple(values))

    def _elevator(self, values: list[LineWord]) -> None:
        self.elevators.append((values[0], values[1], values[2]))
