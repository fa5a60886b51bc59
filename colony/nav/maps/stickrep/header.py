"""The lines of a StickRep file that are neither rings nor rows; `reader.py` tells what each means."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches
from typing import TypeVar, get_args

from colony.nav.maps.stickrep import fields
from colony.nav.maps.stickrep.fields import LENGTH_UNITS, Problems, Word
from colony.nav.maps.stickrep.model import LightOffsets, Travel
from colony.text.source import Source, Span

_T = TypeVar("_T")


class Header:
    """What the header says, as far as it was read.

    What lengths and nodes are in it (`start`, `tolerance`, `links`, `elevators`) is left as words: the line
    that names the unit may come later, and so may the rings.
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
        self.tolerance: Word | None = None
        self.start: tuple[Word, ...] | None = None
        self.links: list[tuple[Word, Word]] = []
        self.elevators: list[tuple[Word, Word, Word]] = []
        self._once: dict[str, Callable[[list[Word]], None]] = {
            "map": self._map,
            "floor": self._floor,
            "start": self._start,
            "unit": self._unit,
            "lights": self._lights,
            "closure": self._closure,
            "travel": self._travel,
        }
        self._often: dict[str, Callable[[list[Word]], None]] = {
            "link": self._link,
            "elevator": self._elevator,
        }

    @property
    def known(self) -> tuple[str, ...]:
        """The words that lines of a header begin with."""
        return (*self._once, *self._often)

    def take(self, words: list[Word]) -> bool:
        """Whether this is a line of the header; it is read if so. What is neither is reported."""
        key = words[0]
        if key.text == "ring" or key.looks_like_number:
            return False
        if key.text in self._often:
            self._take_one_of_many(words)
            return True
        if key.text not in self._once:
            close = get_close_matches(key.text[:40], ["stickrep", "ring", *self.known], n=1)
            hint = f"did you mean `{close[0]}`?" if close else "header lines are: " + ", ".join(self.known)
            message = f"expected a header line, `ring` or a row that begins with an angle; found {key.shown}"
            self.problems.report("M004", key.span, message, hint)
            return False  # perhaps a row: the ring that it stands in is not judged
        if self._is_first(key.text, key.span, f"one `{key.text}` line"):
            self._once[key.text](words)
        return True

    def _take_one_of_many(self, words: list[Word]) -> None:
        line = " ".join(word.text for word in words)
        if self._is_first(line, words[0].span, f"each `{words[0].text}` line once"):
            self._often[words[0].text](words)

    def _is_first(self, key: str, span: Span, expected: str) -> bool:
        if key not in self.seen:
            self.seen[key] = span
            return True
        line, _ = self.source.position(self.seen[key].start)
        message = f"expected {expected}; found a second one, the first is line {line}"
        self.problems.report("M005", span, message, "take one of the two lines out")
        return False

    def _map(self, words: list[Word]) -> None:
        values = fields.values(self.problems, words, "map NAME")
        if values:
            self.name = fields.name(self.problems, values[0], "the map's name")

    def _floor(self, words: list[Word]) -> None:
        values = fields.values(self.problems, words, "floor NAME")
        if values:
            self.floor = fields.name(self.problems, values[0], "the floor's name") or ""

    def _start(self, words: list[Word]) -> None:
        values = fields.values(self.problems, words, "start X Y HEADING")
        self.start = tuple(values) if values else None

    def _closure(self, words: list[Word]) -> None:
        values = fields.values(self.problems, words, "closure LENGTH")
        self.tolerance = values[0] if values else None

    def _unit(self, words: list[Word]) -> None:
        values = fields.values(self.problems, words, "unit NAME")
        if values and values[0].text in LENGTH_UNITS:
            self.unit = values[0].text
        elif values:
            message = f"expected a unit of length, {', '.join(LENGTH_UNITS)}; found {values[0].shown}"
            self.problems.report("M007", values[0].span, message)

    def _lights(self, words: list[Word]) -> None:
        hint = "offsets count from the light before (incremental), or all from the node (cumulative)"
        found = self._one_of(get_args(LightOffsets), words, "lights CONVENTION", hint)
        if found is not None:
            self.light_offsets = found

    def _travel(self, words: list[Word]) -> None:
        hint = "paths follow the rings both ways (either), or only as these are traced (wall-on-left)"
        found = self._one_of(get_args(Travel), words, "travel WAY", hint)
        if found is not None:
            self.travel = found

    def _one_of(self, known: tuple[_T, ...], words: list[Word], form: str, hint: str) -> _T | None:
        """Which of the words `known` a line has; None, and an error, where it is none of them."""
        values = fields.values(self.problems, words, form)
        for one in known:
            if values and values[0].text == one:
                return one
        if values:
            message = f"expected {' or '.join(map(str, known))}; found {values[0].shown}"
            self.problems.report("M007", values[0].span, message, hint)
        return None

    def _link(self, words: list[Word]) -> None:
        values = fields.values(self.problems, words, "link PLACE PLACE")
        if values:
            self.links.append((values[0], values[1]))

    def _elevator(self, words: list[Word]) -> None:
        values = fields.values(self.problems, words, "elevator NODE FILE NODE")
        if values:
            self.elevators.append((values[0], values[1], values[2]))
