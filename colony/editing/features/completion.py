"""What may stand at a place: the grammar says which words and kinds of names, the index which names.

The grammar is asked about the declaration around the place alone, up to the place, which takes a few
milliseconds; where that text has an error, any word and name is offered.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from colony.dsl.parser import accepted_at
from colony.dsl.syntax_errors import DECLARATION_STARTS
from colony.editing.functions import FUNCTIONS
from colony.editing.names import Names, called, dotted
from colony.editing.open_file import OpenFile
from colony.editing.server.protocol import CompletionItem
from colony.editing.text import KEYWORDS, Lexeme, TextPosition, declaration_start, lexemes
from colony.ir.program import SENT
from colony.shipped import Shipped
from colony.text.units import BASE_UNITS, Dimension, UnitError, common_units, parse_unit

_MAX_PARSED = 8192
"""Maximum length of a declaration that the grammar is asked about."""

_COMPOUND = ("mm/s", "m/s", "deg/s", "rad/s", "mm/s^2", "m/s^2", "deg/s^2")
"""Units that are offered besides the plain ones."""

_KINDS = {
    kind: number
    for number, kinds in (
        (3, "function"),
        (5, "field input sensor"),
        (7, "actuator module task"),
        (9, "alias"),
        (13, "sequence machine enum"),
        (20, "member phase"),
        (21, "param"),
    )
    for kind in kinds.split()
}
_VARIABLE, _KEYWORD, _UNIT, _FILE, _FUNCTION = 6, 14, 11, 17, 3

_NEW_NAME = frozenset(
    "let param module state machine sequence enum robot sensor actuator contract reach assume input "
    "as".split()
)
"""Words that a name follows which is not declared yet."""

_BEFORE_PARTS = frozenset({"=", "suppresses", "inhibits", "(", "]"})
"""Words of a network after which the name of a part follows, and not that of a new wire."""

_ACTUATORS, _PHASES = frozenset({"do", "commands", "limit", "idle"}), frozenset({"start", "->"})


def completions(file: OpenFile, position: TextPosition) -> list[CompletionItem]:
    """Return what may be written at a position, the likely first."""
    offset = file.lines.offset(position)
    text = file.text
    word = offset
    while word > 0 and (text[word - 1].isalnum() or text[word - 1] == "_"):
        word -= 1
    begin = declaration_start(text, word)
    before = list(lexemes(text, begin, word))
    last = before[-1] if before else None
    if last is not None and last.kind == "comment" and "\n" not in text[last.start : word]:
        return []
    before = [lexeme for lexeme in before if lexeme.kind != "comment"]
    last = before[-1] if before else None
    if last is not None and last.kind == "string" and (len(last.text) == 1 or not last.text.endswith('"')):
        return _files(file) if len(before) > 1 and before[-2].text == "import" else []
    return list(_items(file, begin, word, before))


def _items(file: OpenFile, begin: int, word: int, before: list[Lexeme]) -> Iterator[CompletionItem]:
    names = Names(file, word)
    last = before[-1] if before else None
    if last is not None and last.text == ".":
        yield from _named(file, _members(names, dotted(before[:-1])))
        return
    if last is not None and last.kind == "number":
        yield from _units(_expected(names, before))
        if last.end == word:
            return
    accepted = accepted_at(file.text, begin, word) if word - begin <= _MAX_PARSED else None
    if accepted is None:
        yield from _named(file, [*names.values, *names.parts])
        yield from _functions()
        yield from _keywords(name.lower() for name in DECLARATION_STARTS)
        return
    if "UNIT" in accepted:
        yield from _types(names)
    elif "NAME" in accepted:
        yield from _names(names, before, "NUMBER" in accepted)
    is_new_line = word == 0 or file.text[word - 1] == "\n"
    yield from _keywords(
        (t.lower() for t in accepted if t in DECLARATION_STARTS), "1" if is_new_line else "5"
    )
    yield from _keywords(t.lower() for t in accepted - DECLARATION_STARTS if t.lower() in KEYWORDS)


# --- names ----------------------------------------------------------------------------------------------


def _names(names: Names, before: list[Lexeme], is_expression: bool) -> Iterator[CompletionItem]:
    """Yield the names that may follow, by what stands before them."""
    file = names.file
    texts = [lexeme.text for lexeme in before]
    last, first = (texts[-1], texts[0]) if texts else ("", "")
    callee = called(before)
    if callee and last in ("(", ","):
        named = [n for owner in names.resolve(callee) for n in _parameters(names, owner)]
        given = {texts[i - 1] for i, t in enumerate(texts) if t == "=" and i}
        for number in dict.fromkeys(named):
            if file.declaration(number).name not in given:
                yield _item(file, number, "-", " = ")
    if last in _PHASES or (names.module >= 0 and last == "else" and not is_expression):
        yield from _named(file, names.of_kind(names.members(names.module), "phase", "task"))
    elif last in _ACTUATORS:
        yield from _named(file, names.of_kind(names.parts, "actuator"))
    elif last == "next":
        yield from _named(file, names.of_kind([*names.local, *names.values], "state"))
    elif last == "by":
        yield from _named(file, names.of_kind([*names.parts, *_tasks(names)], "module", "task"))
    elif first == "network" and last not in _BEFORE_PARTS:
        yield from _named(file, names.of_kind(names.parts, "actuator"))
    elif first == "network" or (last == "=" and not is_expression):
        yield from _named(file, [*names.parts, *_aliases(file)])
    elif last == "given" or (last == "," and not is_expression and "given" in texts):
        yield from _named(file, names.of_kind(names.values, "sensor", "input"))
    elif last in _NEW_NAME or not is_expression:
        return
    else:
        yield from _named(file, names.local, "0")
        yield from _named(file, [*names.values, *_aliases(file)])
        if first in ("contract", "reach", "test"):
            yield from _named(file, names.parts)
        yield from _functions()
        yield _plain(SENT, _VARIABLE, "what was sent in the frame before")


def _aliases(file: OpenFile) -> list[int]:
    return [alias for alias, _ in file.file.aliases]


def _tasks(names: Names) -> list[int]:
    return [n for owner in names.of_kind(names.parts, "sequence") for n in names.members(owner)]


def _parameters(names: Names, owner: int) -> Iterator[int]:
    """Yield what a call of a function, a module or an actuator gives by name."""
    return names.of_kind(names.members(owner), "parameter", "field", "input", "param")


def _members(names: Names, path: Sequence[str]) -> list[int]:
    """Return what may follow a dotted name and a dot."""
    if list(path) == [SENT]:
        return [*names.of_kind(names.parts, "actuator", "module")]
    if len(path) == 1 and (found := names.of_alias(path[0])):
        return found
    return [n for owner in names.resolve(path) for n in names.members(owner)]


# --- units ----------------------------------------------------------------------------------------------


def _expected(names: Names, before: list[Lexeme]) -> Dimension | None:
    """Return the dimension of what a number at the end is compared with, added to, or given to."""
    rest = before[:-1]
    while rest and rest[-1].text in ("-", "(", "..", "in"):
        rest = rest[:-1]
        if rest and rest[-1].kind == "number":
            rest = rest[:-1]
    if not rest or rest[-1].text not in ("<", "<=", ">", ">=", "==", "!=", "+", "-", "=", "range", "within"):
        return None
    if rest[-1].text == "within":
        return BASE_UNITS["s"][0]
    path = dotted(_without_index(rest[:-1]))
    callee = called(rest) if rest[-1].text == "=" else []
    if callee and len(path) == 1:
        owners = names.resolve(callee)
        found = [n for o in owners for n in names.members(o) if names.file.declaration(n).name == path[0]]
    else:
        found = names.resolve(path)
    for number in found:
        type_ = names.file.declaration(number).type.partition("[")[0]
        try:
            return parse_unit(type_).dimension
        except UnitError:
            continue
    return None


def _without_index(before: list[Lexeme]) -> list[Lexeme]:
    """Return the lexemes without an index or the arguments of a call at their end."""
    if not before or before[-1].text not in "])":
        return before
    depth = 0
    for i in range(len(before) - 1, -1, -1):
        depth += (before[i].text in ")]") - (before[i].text in "([")
        if depth == 0:
            return before[:i]
    return []


def _units(expected: Dimension | None) -> Iterator[CompletionItem]:
    likely = () if expected is None else (*_COMPOUND, *BASE_UNITS, *common_units(expected))
    fitting = [unit for unit in dict.fromkeys(likely) if parse_unit(unit).dimension == expected]
    for unit in dict.fromkeys((*fitting, *BASE_UNITS, *_COMPOUND)):
        yield _plain(unit, _UNIT, "unit", "0" if unit in fitting else "5")


def _types(names: Names) -> Iterator[CompletionItem]:
    for name in ("bool", "number"):
        yield _plain(name, _KEYWORD, "type", "0")
    yield from _named(names.file, names.of_kind(names.values, "enum"))
    yield from _units(None)


# --- items ----------------------------------------------------------------------------------------------


def _named(file: OpenFile, numbers: Iterable[int], sort: str = "1") -> Iterator[CompletionItem]:
    seen = set[str]()
    for number in numbers:
        name = file.declaration(number).name
        if name not in seen:
            seen.add(name)
            yield _item(file, number, sort)


def _item(file: OpenFile, number: int, sort: str, suffix: str = "") -> CompletionItem:
    declared = file.declaration(number)
    detail = f"{declared.kind} : {declared.type}" if declared.type else declared.kind
    kind = _KINDS.get(declared.kind, _VARIABLE)
    insert = f"{declared.name}{suffix}" if suffix else ""
    return CompletionItem(declared.name, kind, detail, f"{sort}{declared.name}", insert)


def _plain(label: str, kind: int, detail: str, sort: str = "2") -> CompletionItem:
    return CompletionItem(label, kind, detail, f"{sort}{label}")


def _functions() -> Iterator[CompletionItem]:
    for name, (usage, meaning) in FUNCTIONS.items():
        yield CompletionItem(name, _FUNCTION, usage, f"3{name}", documentation=meaning)


def _keywords(words: Iterable[str], sort: str = "4") -> Iterator[CompletionItem]:
    for word in sorted(words):
        yield _plain(word, _KEYWORD, "keyword", sort)


def _files(file: OpenFile) -> list[CompletionItem]:
    """Return what an import can name: the behaviors beside the file, and those that come with colony."""
    folder = Path(file.path).parent
    own = sorted(path.name for path in folder.glob(f"*{Shipped.BEHAVIOR.suffix}") if str(path) != file.path)
    shipped = [name for kind in (Shipped.ROBOT, Shipped.BEHAVIOR, Shipped.LIBRARY) for name in kind.names()]
    return [
        _plain(name, _FILE, "file", "0" if name in own else "1") for name in dict.fromkeys((*own, *shipped))
    ]
