"""A table-driven LALR(1) parser with a contextual lexer.

lark builds the tables from the grammar (`colony.dsl.tables`); only this module reads them, so that no command
has to import lark. It behaves like lark with its contextual lexer: a terminal is recognized only where the
grammar allows it, words before punctuation before patterns, and absent optional parts are None.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, TypeAlias

END = "$END"
"""The terminal at the end of a text."""

_BLANKS = re.compile(r"(?:[ \t\r\n\f]+|#[^\r\n]*)*")
_WORD = re.compile(r"\w+")

Rule: TypeAlias = tuple[str, int, "Callable[[list[Any]], Any] | None", "list[list[int]] | None"]
"""Nonterminal, number of symbols, builder method, and layout (see `_arrange`) if it is needed."""


class Token:
    """An occurrence of a terminal, at `text[start:end]`."""

    __slots__ = ("end", "start", "text", "type")

    def __init__(self, type_: str, text: str, start: int, end: int) -> None:
        self.type, self.text, self.start, self.end = type_, text, start, end


class UnexpectedInputError(Exception):
    """The first unexpected input in a text.

    Attributes:
        offset: the start of the input; at the end of the text, the end of the last token.
        at_end: True if the text ends too early.
        accepted: the terminals that are allowed there.
        values: the parser's stack of values at that point.
    """

    def __init__(self, *, offset: int, at_end: bool, accepted: frozenset[str], values: list[Any]) -> None:
        super().__init__(f"unexpected input at offset {offset}")
        self.offset, self.at_end, self.accepted, self.values = offset, at_end, accepted, values


class Parser:
    """A parser of one grammar.

    Args:
        tables: the tables from `colony.dsl.tables.load`.
        builder: an object with a method for each rule, named after it, from the rule's children to its value.
    """

    def __init__(self, tables: dict[str, Any], builder: object) -> None:
        self._words: dict[str, str] = tables["words"]
        self._punctuation: dict[str, str] = tables["signs"]
        self._patterns = [(name, re.compile(pattern)) for name, pattern in tables["patterns"]]
        self._rows: list[dict[str, int]] = tables["rows"]
        self._start: int = tables["start"]
        self._final: int = tables["final"]
        self._rules: list[Rule] = [
            (origin, size, getattr(builder, method) if method else None, layout)
            for origin, size, method, layout in tables["rules"]
        ]

    def parse(self, text: str, start: int = 0) -> Any:
        """Parse a text from `start` to its end, and return its value.

        Raises:
            UnexpectedInputError: the text does not follow the grammar.
        """
        states, values = [self._start], list[Any]()
        while True:
            token = self._token(text, start, self._rows[states[-1]])
            if token is None or not self._feed(token, states, values):
                offset = start if token and token.type == END else _skip_blanks(text, start)
                raise UnexpectedInputError(
                    offset=offset,
                    at_end=token is not None and token.type == END,
                    accepted=frozenset(t for t in self._rows[states[-1]] if self._can_follow(t, states)),
                    values=values,
                )
            if token.type == END:
                return values[-1]
            start = token.end

    def _token(self, text: str, start: int, row: dict[str, int]) -> Token | None:
        """Return the next token if its terminal is in this row of the table, otherwise None."""
        position = _skip_blanks(text, start)
        if position == len(text):
            return Token(END, "", start, start)
        word = _WORD.match(text, position)
        if word is not None:
            type_ = self._words.get(word[0])
            if type_ in row:
                return Token(type_, word[0], position, word.end())
        else:
            for mark in (text[position : position + 2], text[position]):
                type_ = self._punctuation.get(mark)
                if type_ in row:
                    return Token(type_, mark, position, position + len(mark))
        for type_, pattern in self._patterns:
            if type_ in row and (match := pattern.match(text, position)):
                return Token(type_, match[0], position, match.end())
        return None

    def _feed(self, token: Token, states: list[int], values: list[Any]) -> bool:
        """Reduce until the token can be shifted, and shift it.

        Return False, with `states` unchanged, if the token is not allowed here.
        """
        type_, rows = token.type, self._rows
        removed: list[list[int]] = []  # states removed by each reduction, to undo them for a refused token
        while True:
            action = rows[states[-1]].get(type_)
            if action is None:
                for removed_states in reversed(removed):
                    states[-1:] = removed_states
                return False
            if action >= 0:
                states.append(action)
                values.append(token)
                return True
            origin, size, build, layout = self._rules[~action]
            first = len(values) - size
            children = values[first:]
            removed.append(states[first + 1 :])
            del states[first + 1 :], values[first:]
            if layout is not None:
                children = _arrange(children, layout)
            values.append(build(children) if build else children[0] if origin[0] != "_" else children)
            states.append(rows[states[-1]][origin])
            if type_ == END and states[-1] == self._final:
                return True

    def _can_follow(self, symbol: str, states_before: list[int]) -> bool:
        """Return True if the symbol is a terminal that can be shifted, perhaps after reductions."""
        states = states_before.copy()
        while (action := self._rows[states[-1]].get(symbol)) is not None and symbol.isupper():
            if action >= 0 or states[-1] == self._final:
                return True
            origin, size, _, _ = self._rules[~action]
            del states[len(states) - size :]
            states.append(self._rows[states[-1]][origin])
            if symbol == END and states[-1] == self._final:
                return True
        return False


def _skip_blanks(text: str, start: int) -> int:
    match = _BLANKS.match(text, start)
    return start if match is None else match.end()


def _arrange(children: list[Any], layout: list[list[int]]) -> list[Any]:
    """Return the children with None for each absent part, and with the lists of helper rules flattened.

    `layout` has a pair for each symbol (the number of absent parts before it, and 1 if it is a list), and one
    for the end.
    """
    arranged: list[Any] = []
    for child, (absent, is_list) in zip(children, layout, strict=False):
        arranged += [None] * absent
        if not is_list:
            arranged.append(child)
        elif arranged:
            arranged += child
        else:  # reuse the list instead of copying it: it may be as long as the file
            arranged = child
    arranged += [None] * layout[-1][0]
    return arranged
