"""Hints for syntax errors: the common mistakes that lead to them."""

from __future__ import annotations

import re
import unicodedata

from colony.text.suggestions import did_you_mean
from colony.text.units import BASE_UNITS

RESERVED = frozenset(
    "and or not implies if then else in is by suppresses inhibits true false missing".split()
)

DECLARATION_STARTS = frozenset(
    "ROBOT ENUM IMPORT PARAM LET STATE NEXT MACHINE FAILSAFE MODULE NETWORK LIMIT CONTRACT REACH TEST".split()
)
_KEYWORDS = frozenset(name.lower() for name in DECLARATION_STARTS) | {"when", "do"}
_SLIP_HINTS = {
    "&": "write `and`",
    "&&": "write `and`",
    "|": "write `or`",
    "||": "write `or`",
    "!": "write `not`",
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
    "elif": "write `else if`",
    "elseif": "write `else if`",
    "None": "write `missing`",
    "null": "write `missing`",
    "True": "write `true`",
    "False": "write `false`",
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
    **dict.fromkeys(("input", "when", "do"), "it belongs inside `module NAME { ... }`"),
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
        return "compare with `==`"
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
        return "write `=`"
    if found == "," and {"AT", "EXPECT"} <= accepted:
        return "there is no comma before `given` and `expect`"
    return None


def _word_hint(before: str, found: str, accepted: frozenset[str]) -> str | None:
    if found == "if" and "LPAR" in accepted and "NUMBER" in accepted:
        return "an `if` to the right of an operator needs parentheses"
    if found in ("input", "let", "param", "state", "next") and "DO" in accepted:
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
        return "strings are allowed only after `import`, `test` and `python`"
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
