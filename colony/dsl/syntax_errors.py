"""Messages for syntax errors: what was found, what was expected, and the likely mistake."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable

from colony.dsl.parser import Unexpected, expected_terminals, new_declaration
from colony.record import Record, record
from colony.text.diagnostics import Diagnostic, Label, error
from colony.text.source import Source, Span
from colony.text.units import BASE_UNITS
from colony.text.wording import Remedy, did_you_mean, listed

# --- syntax hints -------------------------------------------------------------------------------------
#
# Hints for syntax errors: the common mistakes that lead to them.

RESERVED = frozenset(
    "and or not implies if then else in is by suppresses inhibits true false missing".split()
)

DECLARATION_STARTS = frozenset(
    (
        "ROBOT ENUM IMPORT INPUT TUNABLE PARAM LET STATE NEXT MACHINE SEQUENCE FAILSAFE MODULE NETWORK LIMIT "
        "CONTRACT REACH ASSUME TEST"
    ).split()
)
_KEYWORDS = frozenset(name.lower() for name in DECLARATION_STARTS) | {"when", "do"}
_SLIP_HINTS = {
    "&": Remedy("write `and`", "&", "and"),
    "&&": Remedy("write `and`", "&&", "and"),
    "|": Remedy("write `or`", "|", "or"),
    "||": Remedy("write `or`", "||", "or"),
    "!": Remedy("write `not`", "!", "not"),
    ";": "clauses have no terminator: leave the `;` out",
    "'": "strings are written in double quotes",
    "//": "comments begin with `#`",
    "/*": "comments begin with `#`",
    "**": "powers of numbers are written as products",
    "%": "write `mod(x, y)`",
    "?": "write `if CONDITION then A else B`",
    "=>": "write `implies` between bools, `>=` between numbers",
    "xor": "write `a != b`",
    "^": "powers are allowed only in units, without spaces: `m/s^2`",
    "elif": Remedy("write `else if`", "elif", "else if"),
    "elseif": Remedy("write `else if`", "elseif", "else if"),
    "None": Remedy("write `missing`", "None", "missing"),
    "null": Remedy("write `missing`", "null", "missing"),
    "True": Remedy("write `true`", "True", "true"),
    "False": Remedy("write `false`", "False", "false"),
    **dict.fromkeys(
        ("def", "fn", "func", "function", "lambda"),
        "a function is `let NAME(PARAMETER : TYPE, ...) = EXPRESSION`",
    ),
    **dict.fromkeys(("var", "const", "val", "auto"), "name a value with `let NAME = ...`"),
    **dict.fromkeys(("class", "behavior", "behaviour"), "a behavior is a `module NAME { when ... do ... }`"),
    **dict.fromkeys(("for", "while", "loop"), "there are no loops: a program decides one frame at a time"),
    "return": "a module's command follows `do`",
}


_CONTEXT_HINTS = {
    **dict.fromkeys(("sensor", "actuator", "frame"), "it belongs inside `robot NAME { ... }`"),
    **dict.fromkeys(("when", "do"), "it belongs inside `module NAME { ... }`"),
    **dict.fromkeys(("reads", "commands", "rate"), "it belongs inside a Python module"),
    **dict.fromkeys(("at", "given", "expect"), 'it belongs inside `test "TITLE" { ... }`'),
}


_LOOKALIKES = {
    **dict.fromkeys("‐‑‒–—―−﹣", "`-`"),
    **dict.fromkeys("×·∙⋅∗", "`*`"),
    **dict.fromkeys("÷∕⁄", "`/`"),
    **dict.fromkeys("→⟶➔", "`->`"),
    **dict.fromkeys("“”„‟«»‘’‚‹›", "a straight double quote"),
    "≤": "`<=`",
    "≥": "`>=`",
    "≠": "`!=`",
    "…": "`..`",
    "∧": "`and`",
    "∨": "`or`",
    "¬": "`not`",
    "°": "`deg`",
}
"""Hints for typographic characters that keyboards and word processors insert, by character."""


def _lookalike_hint(text: str, offset: int) -> str | None:
    """Return a hint for a character that the language does not have, but that looks like some of it."""
    found = text[offset : offset + 1]
    if not found or found.isascii():
        return None
    plain, category = unicodedata.normalize("NFKC", found), unicodedata.category(found)
    if plain == "μ":
        return f"no unit begins with {found}: 1 {found}s is `0.001 ms`, and 1 {found}m is `0.001 mm`"
    if plain in _SLIP_HINTS:
        return _SLIP_HINTS[plain]
    if text.startswith("°C", offset):
        written = "`degC` for `°C`"
    elif found in _LOOKALIKES:
        written = _LOOKALIKES[found]
    elif plain.isspace():
        written = "a plain space"
    elif category == "No" and plain.isdecimal():
        written = f"`^{plain}`, in units alone"
    elif category == "Cf":
        return f"remove it: it is {_character(found)}, which cannot be seen"
    elif len(plain) == 1 and plain.isascii():
        written = f"`{plain}`"
    else:
        return None
    return f"write {written}; this is {_character(found)}"


def _character(found: str) -> str:
    """Return a character by its number and name."""
    return f"U+{ord(found):04X} ({unicodedata.name(found, 'no name').lower()})"


def hint_for(text: str, offset: int, found: str, accepted: frozenset[str]) -> str | None:
    """Return a hint about what the author probably meant to write, or None."""
    before = text[max(offset - 40, 0) : offset]
    percentage = _percentage(before, text[offset + 1 :]) if found == "%" else None
    if percentage is not None:
        return f"write `{percentage} percent`"
    if found == "for" and re.match(r"[ \t]+[\d.]+[ \t]*(ms|s|min|h)\b", text[offset + 3 : offset + 40]):
        return (
            "write `sustained(..., 400 ms)` if the condition must have held all that time, "
            "`recently(..., 400 ms)` if it held at any moment of it"
        )
    if found == "in" and re.search(r"\breach\s+\w+\s+$", before):
        return "a `reach` is always about runs with every client in time: leave out `in time`"
    if found == "language" and re.match(r"[ \t]*\d", text[offset + len(found) :]):
        return "a file has this line once, before its first declaration"
    return (
        _lookalike_hint(text, offset)
        or _did_you_mean(found, accepted)
        or _number_hint(before, found, text[offset + len(found) : offset + len(found) + 40], accepted)
        or _punctuation_hint(text, offset, found, accepted)
        or _word_hint(before, found, accepted)
        or (_CONTEXT_HINTS.get(found) if "MODULE" in accepted else None)
        or _SLIP_HINTS.get(found)
        or _name_hint(found, accepted)
    )


def _percentage(before: str, after: str) -> str | None:
    """Return the number before a `%` that no operand follows, or None."""
    number = re.search(r"(?<![\w.])(\d[\d.]*)[ \t]*$", before)
    following = re.match(r"[ \t]*(\w+|\()", after)
    is_operand = following is not None and following[1] not in RESERVED | _KEYWORDS
    return None if number is None or is_operand else number[1]


_AFTER_NUMBER = re.compile(r"(?<![\w.])\d[\d.]*([ \t]*)$")


def _number_hint(before: str, found: str, after: str, accepted: frozenset[str]) -> str | None:
    number = _AFTER_NUMBER.search(before)
    begins_next = re.match(r"\s*(=|:|->)", after) or found in RESERVED | _KEYWORDS
    if number and re.match(r"[A-Za-z_]", found) and not begins_next:
        if re.match(r"[xXoObB][0-9a-fA-F]|_\d|[eE]$", found) and not number[1]:
            return "numbers are decimal: digits, optionally with a fraction (`.5`) and an exponent (`e-3`)"
        return f"`{found}` is not a unit; the units are {', '.join(BASE_UNITS)} and their products"
    if number and found == "." and not number[1]:
        return "a number needs a digit after the point: `5.0`"
    if found == "." and "NUMBER" in accepted:
        return "a number needs a digit before the point: `0.5`"
    return None


def _punctuation_hint(text: str, offset: int, found: str, accepted: frozenset[str]) -> str | None:
    if found == "=" and "EQUAL" in accepted:
        return Remedy("compare with `==`", "=", "==")
    if found == "=>" and "ARROW" in accepted:
        return "a transition is written `a -> b when CONDITION`"
    if found == "==" and "ASSIGN" in accepted:
        return "a single `=` gives something a value; `==` compares"
    if found in ("<", ">", "<=", ">=", "==", "!=") and "AND" in accepted:
        return "comparisons do not chain: write `a < b and b < c`, or `b in a .. c`"
    if (
        found in "*/"
        and "UNIT" not in accepted
        and re.search(r":[ \t]*[A-Za-z]+[ \t]+$", text[max(offset - 40, 0) : offset])
    ):
        return "a unit is written without spaces: `mm/s`"
    if found == ":" and {"DOTS", "RSQB"} <= accepted:
        return "a slice is written `sonar[1..3]` or `sonar[-30 deg .. 30 deg]`, with both ends"
    if found == ":" and "ASSIGN" in accepted:
        return Remedy("write `=`", ":", "=")
    if found == "," and {"AT", "EXPECT"} <= accepted:
        return "there is no comma before `given` and `expect`"
    return None


_TUNABLE = re.compile(r"\btunable[ \t]+param\b[^{}\n]*\s*\Z")
_INPUT_OF_A_FILE = re.compile(r"^[ \t]*input\b[^{}]*\Z", re.MULTILINE)


def _word_hint(before: str, found: str, accepted: frozenset[str]) -> str | None:
    if "IN" in accepted and _TUNABLE.search(before):
        return "a tunable param is a number in an interval: `tunable param NAME = NUMBER in LOW .. HIGH`"
    if {"FROM", "DEFAULT"} <= accepted and _INPUT_OF_A_FILE.search(before):
        return "an input of a file is `from DServer.NAME`; those of modules stand in `module NAME { ... }`"
    if found == "if" and "LPAR" in accepted and "NUMBER" in accepted:
        return "an `if` to the right of an operator needs parentheses"
    if found in ("input", "let", "param", "tunable", "state", "next") and "DO" in accepted:
        return f"`{found}` belongs before `when`"
    if found == "do" and {"WHEN", "LET"} <= accepted:
        return "`when` comes before `do`; write `when true` for always"
    if found == "when" and "DO" in accepted:
        return "a module has one `when`: join conditions with `and` or `or`"
    if found in ("not", "by") and "COMMANDED" in accepted:
        return "write `ACTUATOR by MODULE`" if found == "by" else "write `not (drive is idle)`"
    if found in ("suppresses", "inhibits") and "AND" in accepted:
        return "modules are wired in a `network { ... }` block"
    if found in ("suppresses", "inhibits") and accepted == {"ASSIGN"}:
        return f"name the wire, or the actuator that it drives: `NAME = {before.split()[-1]} {found} ...`"
    return None


def misspelled_relation(text: str, offset: int, accepted: frozenset[str]) -> tuple[int, str, str] | None:
    """Return the offset of a misspelled `suppresses` or `inhibits` before `offset`, the word, and a hint.

    The parser took the word for the name of a wire, which must be followed by `=`.
    """
    before = re.search(r"[\w)](?:\s+)([A-Za-z]\w*)\s+$", text[:offset][-200:])
    if before is None or accepted != {"ASSIGN"}:
        return None
    hint = did_you_mean(before[1], ("suppresses", "inhibits"), cutoff=0.7)
    return (
        None
        if hint is None
        else (offset - len(before[0]) + before.start(1) - before.start(), before[1], hint)
    )


def _name_hint(found: str, accepted: frozenset[str]) -> str | None:
    if found in RESERVED and "NAME" in accepted:
        return f"`{found}` is a reserved word and cannot be a name"
    if found[:1].isalpha() and not found.isascii():
        strange = next(c for c in found if not c.isascii())
        return (
            f"names are made of the letters A to Z and a to z, digits and `_`; this is {_character(strange)}"
        )
    if found.startswith('"') and "STRING" not in accepted:
        return "texts in quotes stand only after `import`, `test`, `python` and `requirement`"
    return None


def _did_you_mean(found: str, accepted: frozenset[str]) -> str | None:
    if not found.isidentifier():
        return None
    words = (t.lower() for t in accepted if t.lower() not in _NON_KEYWORDS)
    return did_you_mean(found, words, cutoff=0.7)


_NON_KEYWORDS = frozenset(
    "name field number string unit plus minus times over less greater equal unequal comma dot colon "
    "dots arrow assign lbrace rbrace lpar rpar lsqb rsqb".split()
)


# --- declaration hints --------------------------------------------------------------------------------
#
# Hints for syntax errors in the form of a declaration, found by what stands before and after the error.

_NEARBY = 300
"""Number of characters before and after an error in which its hint is looked for."""


@record
class SyntaxSlip(Record):
    """A syntax error with the text around it.

    Attributes:
        head: the word that begins the declaration.
        before: the end of the text before the error.
        found: the word or punctuation at the error.
        after: the beginning of the text after `found`.
        accepted: the terminals that are allowed at the error.
    """

    head: str
    before: str
    found: str
    after: str
    accepted: frozenset[str]


def declaration_hint(
    text: str, declaration_start: int, offset: int, found: str, accepted: frozenset[str]
) -> str | None:
    """Return a hint about the form that the declaration at `declaration_start` should have, or None."""
    head = _HEAD.match(text, declaration_start)
    end = offset + len(found)
    slip = SyntaxSlip(
        head=head[1] if head else "",
        before=text[max(offset - _NEARBY, 0) : offset],
        found=found,
        after=text[end : end + _NEARBY],
        accepted=accepted,
    )
    return next((hint for form in _FORMS if (hint := form(slip)) is not None), None)


_HEAD = re.compile(r"(?:[ \t\r\n\f]|#[^\r\n]*)*(?:failsafe[ \t]+)?(\w*)")


def _missing_type(slip: SyntaxSlip) -> str | None:
    name = re.search(r"(\w+)\s*$", slip.before)
    if name is None or slip.accepted != {"COLON", "LSQB"}:
        return None
    clause = re.search(r"\b(input|sensor)\s+\w+\s*$", slip.before)
    if clause is not None:
        article = "an" if clause[1] == "input" else "a"
        return f"{article} {clause[1]} has a type, for example `{clause[1]} {name[1]} : mm`"
    return f"a parameter has a type, for example `{name[1]} : mm`" if slip.head == "let" else None


def _array_type(slip: SyntaxSlip) -> str | None:
    typed = re.search(r"(?:(\b(?:input|sensor)\s+)|[(,]\s*)(\w+)\s*:\s*([\w/^.*-]+)\s*$", slip.before)
    if slip.found != "[" or typed is None or not (typed[1] or slip.head == "let"):
        return None
    size = re.match(r"\s*(\w*)\s*\]", slip.after)
    return f"the brackets stand after the name: `{typed[2]}[{size[1] if size else ''}] : {typed[3]}`"


def _type_of_let(slip: SyntaxSlip) -> str | None:
    if slip.head != "let" or slip.found not in (":", "->") or "ASSIGN" not in slip.accepted:
        return None
    if slip.after.startswith("="):
        return None
    if re.search(r"\)\s*$", slip.before):
        return "the type of the result is not written: it is that of the expression after `=`"
    return "the type of a `let` is not written: it is that of the expression after `=`"


def _arguments_by_name(slip: SyntaxSlip) -> str | None:
    begins = "NAME" in slip.accepted and not slip.accepted & {"NUMBER", "PLUS"}
    begins = begins and re.match(r"[\w(.-]", slip.found) is not None
    if not begins and slip.accepted != {"ASSIGN"}:
        return None
    derived = re.search(r"\bmodule\s+\w+\s*=\s*([\w.]+)\s*\([^()]*$", slip.before)
    if derived is not None:
        return f"inputs and params are given by name: `{derived[1]}(NAME = VALUE)`"
    command = re.search(r"\b(?:do|idle)\s+(\w+)\s*\([^()]*$", slip.before)
    return f"fields are given by name: `{command[1]}(FIELD = VALUE)`" if command else None


def _inputs_inside(slip: SyntaxSlip) -> str | None:
    name = re.search(r"\bmodule\s+(\w+)\s*$", slip.before)
    if slip.found != "(" or name is None:
        return None
    return f"inputs are declared inside: `module {name[1]} {{ input NAME : TYPE ... }}`"


def _derived_in_network(slip: SyntaxSlip) -> str | None:
    name = re.search(r"([\w.]+)\s*$", slip.before)
    if slip.head != "network" or slip.found != "(" or name is None:
        return None
    if re.match(r"\s*(?:\w+\s*=|\)|\d)", slip.after) is None:
        return None
    return f"derive it above the network, `module NAME = {name[1]}(...)`, and wire `NAME`"


def _list(slip: SyntaxSlip) -> str | None:
    if slip.found != "[" or "NUMBER" not in slip.accepted or "LSQB" in slip.accepted:
        return None
    if re.match(r"[^\[\]]*\sfor\s", slip.after):
        return "a reduction has no brackets: `min(r for r in ranges)`"
    return "there are no lists of values: arrays are sensors, slices of them, and what is computed from them"


def _loop_variables(slip: SyntaxSlip) -> str | None:
    if slip.found != "(" or not re.search(r"\bfor\s+$", slip.before):
        return None
    return "variables have no parentheses: `for r, a in ranges`"


def _loop_condition(slip: SyntaxSlip) -> str | None:
    is_condition = slip.found in ("where", "when") and {"IF", "RPAR"} <= slip.accepted
    return "write `if`" if is_condition else None


_SENSOR_PARTS = ("bearing", "range", "default", "from", "within")


def _sensor_order(slip: SyntaxSlip) -> str | None:
    sensor = re.search(r"\bsensor\s+\w([^{}]*)$", slip.before)
    if slip.head != "robot" or sensor is None:
        return None
    if slip.found == ".." and re.search(r"\bbearing\s[^{}]*$", sensor[1]) and "STEP" in slip.accepted:
        return "bearings have a first one and a step: `bearing 0 deg step 30 deg`"
    if slip.found not in _SENSOR_PARTS or slip.found.upper() in slip.accepted:
        return None
    if re.search(rf"\b{slip.found}\b", sensor[1]):
        return f"`{slip.found}` is given once"
    return "the order is: type, `bearing`, `range`, `default`, `from`, `within`"


def _robot_import(slip: SyntaxSlip) -> str | None:
    if not re.search(r"\bimport\s+robot\s+$", slip.before):
        return None
    if slip.found.startswith('"'):
        return "`import robot` takes no name: choose the robot with --robot NAME, or in colony.toml"
    return "`import robot` takes no alias: the robot's names have no prefix" if slip.found == "as" else None


def _contract_condition(slip: SyntaxSlip) -> str | None:
    if slip.head != "contract" or slip.found not in ("when", "if") or "IMPLIES" not in slip.accepted:
        return None
    condition = re.match(r"[ \t]*([^\r\n#]{1,40}?)[ \t]*(?:[\r\n#]|$)", slip.after)
    return f"write the condition first: `{condition[1] if condition else 'CONDITION'} implies ...`"


def _task(slip: SyntaxSlip) -> str | None:
    if slip.head != "sequence" or "{" not in slip.before:
        return None
    return "a task is written `NAME [= BASE(...)] until CONDITION [within 10 s else PHASE]`"


_FORMS: tuple[Callable[[SyntaxSlip], str | None], ...] = (
    _missing_type,
    _array_type,
    _type_of_let,
    _arguments_by_name,
    _inputs_inside,
    _derived_in_network,
    _list,
    _loop_variables,
    _loop_condition,
    _sensor_order,
    _robot_import,
    _contract_condition,
    _task,
)


# --- syntax errors ------------------------------------------------------------------------------------

_OPERATORS = frozenset(
    "PLUS MINUS TIMES OVER LESS AT_MOST GREATER AT_LEAST EQUAL UNEQUAL AND OR IMPLIES IN BY IS "
    "LSQB DOT".split()
)
_EXPRESSION_STARTS = frozenset("NUMBER TRUE FALSE NAME LPAR MINUS NOT IF".split())
_SPELLED = {
    "NAME": "a name",
    "FIELD": "a name",
    "NUMBER": "a number",
    "STRING": "a text in double quotes",
    "UNIT": "a unit",
    "LBRACE": "`{`",
    "RBRACE": "`}`",
    "LPAR": "`(`",
    "RPAR": "`)`",
    "LSQB": "`[`",
    "RSQB": "`]`",
    "COLON": "`:`",
    "COMMA": "`,`",
    "DOT": "`.`",
    "EQUAL": "`==`",
    "AT_MOST": "`<=`",
    "AT_LEAST": "`>=`",
    "DOTS": "`..`",
    "ARROW": "`->`",
    "ASSIGN": "`=`",
    "PLUS": "`+`",
    "MINUS": "`-`",
    "TIMES": "`*`",
    "OVER": "`/`",
    "LESS": "`<`",
    "GREATER": "`>`",
    "UNEQUAL": "`!=`",
    "$END": "the end of the file",
}
_WORD = re.compile(
    r'"[^"\r\n]*"|[A-Za-z_]\w*|\d[\w.]*|==|<=|>=|!=|=>|->|\.\.|&&|\|\||//|/\*|\*\*|\+=|-=|.', re.DOTALL
)
_SPLITTABLE = ("==", "**", "=>", "->", "..", "<=", ">=", "//", "/*")
"""Punctuation whose first character may have been read as a token before the error was detected."""


def describe(source: Source, problem: Unexpected, declaration_start: int) -> Diagnostic:
    """Return the diagnostic of a syntax error in the declaration at `declaration_start`."""
    text, offset, at_end = source.text, problem.offset, problem.at_end
    accepted = expected_terminals(problem)
    if text[max(offset - 1, 0) : offset + 1] in _SPLITTABLE and not at_end:
        offset, accepted = offset - 1, _accepted_before(text[offset - 1], accepted)
    found = "" if at_end else _word_at(text, offset)
    span = Span(source, max(offset - 1, 0), offset) if at_end else Span(source, offset, offset + len(found))
    new_start = None if at_end else new_declaration(text, declaration_start, offset)
    bracket = _open_bracket(text, declaration_start, offset if new_start is None else new_start)
    if bracket is not None and (at_end or new_start is not None or _closes_another(text[bracket], found)):
        return _unclosed(source, span, bracket, found, new_start)
    if new_start is not None and new_start < offset:
        word = _word_at(text, new_start)
        message = f"`{word}` begins a declaration, and the one before it is not complete"
        return error("E005", Span(source, new_start, new_start + len(word)), message)
    if found == '"':
        hint = 'add the missing `"`; a text ends on the line on which it begins'
        return error("E006", span, "the text that begins here is not closed on its line", hint)
    node = misspelled_relation(text, offset, accepted)
    if node is not None:
        start, word, hint = node
        message = f"found `{word}`, expected `suppresses` or `inhibits`"
        return error("E005", Span(source, start, start + len(word)), message, hint)
    shown = "the end of the file" if at_end else _quoted(found)
    message = f"found {shown}, expected {_expected(accepted)}"
    form = declaration_hint(text, declaration_start, offset, found, accepted)
    return error("E005", span, message, form or hint_for(text, offset, found, accepted))


def _accepted_before(read: str, accepted: frozenset[str]) -> frozenset[str]:
    """Return the terminals accepted before `character`, which was taken for an operator."""
    accepted_before = {"=": {"ASSIGN"}, "*": _OPERATORS, "/": _OPERATORS, "<": _OPERATORS, ">": _OPERATORS}
    return frozenset(accepted_before.get(read, accepted))


def _word_at(text: str, offset: int) -> str:
    match = _WORD.match(text, offset)
    return match[0][:60] if match else ""


def _quoted(found: str) -> str:
    if found and not found.isprintable():
        return f"the character U+{ord(found[0]):04X}"
    return f"`{found}`"


def _expected(accepted: frozenset[str]) -> str:
    names = set(accepted)
    parts: list[str] = []
    if {"NUMBER", "NAME", "LPAR"} <= names:
        parts.append("an expression")
        names -= _EXPRESSION_STARTS
    if "PLUS" in names:
        parts.append("an operator")
        names -= _OPERATORS | {"LPAR"}
    elif {"SUPPRESSES", "INHIBITS"} <= names:
        names -= {"DOT", "LSQB"}
    if len(names & DECLARATION_STARTS) > 6:
        parts.append("a declaration (`robot`, `module`, `network`, ...)")
        names -= DECLARATION_STARTS | {"$END"}
    parts += sorted({_spell(name) for name in names if not name.startswith("__IGNORE")})
    if not parts:
        return "something else"
    return listed(parts, "or")


def _spell(terminal: str) -> str:
    if terminal in _SPELLED:
        return _SPELLED[terminal]
    return f"`{terminal.lower()}`"


_BRACKET = re.compile(r'"[^"\r\n]*"|#[^\r\n]*|[(){}\[\]]')


def _open_bracket(text: str, start: int, end: int) -> int | None:
    """Return the offset of the innermost bracket opened in `text[start:end]` and not closed there."""
    opened: list[int] = []
    for match in _BRACKET.finditer(text, start, end):
        if match[0] in "([{":
            opened.append(match.start())
        elif match[0] in ")]}" and opened:
            opened.pop()
    return opened[-1] if opened else None


_CLOSING = {"(": ")", "[": "]", "{": "}"}


def _closes_another(bracket: str, found: str) -> bool:
    return found in ")]}" and found != "" and _CLOSING[bracket] != found


def _unclosed(source: Source, span: Span, bracket: int, found: str, new_start: int | None) -> Diagnostic:
    """Report a bracket that is open where the file ends, another closes, or a declaration begins."""
    closing = _CLOSING[source.text[bracket]]
    event = f"found `{found}`" if found else "the file ends"
    if new_start is not None:
        word = _word_at(source.text, new_start)
        span, event = Span(source, new_start, new_start + len(word)), f"`{word}` begins a declaration"
    message = f"{event} before the `{source.text[bracket]}` is closed"
    opened = Label(Span(source, bracket, bracket + 1), "opened here")
    return error("E006", span, message, f"add the missing `{closing}`", opened)
