"""Hints for syntax errors in the form of a declaration, found by what stands before and after the error."""

from __future__ import annotations

import re
from collections.abc import Callable

from colony.record import Record, record

_NEARBY = 300
"""Number of characters before and after an error in which its hint is looked for."""


@record
class Slip(Record):
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
    slip = Slip(
        head=head[1] if head else "",
        before=text[max(offset - _NEARBY, 0) : offset],
        found=found,
        after=text[end : end + _NEARBY],
        accepted=accepted,
    )
    return next((hint for form in _FORMS if (hint := form(slip)) is not None), None)


_HEAD = re.compile(r"(?:[ \t\r\n\f]|#[^\r\n]*)*(?:failsafe[ \t]+)?(\w*)")


def _missing_type(slip: Slip) -> str | None:
    name = re.search(r"(\w+)\s*$", slip.before)
    if name is None or slip.accepted != {"COLON", "LSQB"}:
        return None
    clause = re.search(r"\b(input|sensor)\s+\w+\s*$", slip.before)
    if clause is not None:
        article = "an" if clause[1] == "input" else "a"
        return f"{article} {clause[1]} has a type, for example `{clause[1]} {name[1]} : mm`"
    return f"a parameter has a type, for example `{name[1]} : mm`" if slip.head == "let" else None


def _array_type(slip: Slip) -> str | None:
    typed = re.search(r"(?:(\b(?:input|sensor)\s+)|[(,]\s*)(\w+)\s*:\s*([\w/^.*-]+)\s*$", slip.before)
    if slip.found != "[" or typed is None or not (typed[1] or slip.head == "let"):
        return None
    size = re.match(r"\s*(\w*)\s*\]", slip.after)
    return f"the brackets stand after the name: `{typed[2]}[{size[1] if size else ''}] : {typed[3]}`"


def _type_of_let(slip: Slip) -> str | None:
    if slip.head != "let" or slip.found not in (":", "->") or "ASSIGN" not in slip.accepted:
        return None
    if slip.after.startswith("="):
        return None
    if re.search(r"\)\s*$", slip.before):
        return "the type of the result is not written: it is that of the expression after `=`"
    return "the type of a `let` is not written: it is that of the expression after `=`"


def _arguments_by_name(slip: Slip) -> str | None:
    begins = "NAME" in slip.accepted and not slip.accepted & {"NUMBER", "PLUS"}
    begins = begins and re.match(r"[\w(.-]", slip.found) is not None
    if not begins and slip.accepted != {"ASSIGN"}:
        return None
    derived = re.search(r"\bmodule\s+\w+\s*=\s*([\w.]+)\s*\([^()]*$", slip.before)
    if derived is not None:
        return f"inputs and params are given by name: `{derived[1]}(NAME = VALUE)`"
    command = re.search(r"\b(?:do|idle)\s+(\w+)\s*\([^()]*$", slip.before)
    return f"fields are given by name: `{command[1]}(FIELD = VALUE)`" if command else None


def _inputs_inside(slip: Slip) -> str | None:
    name = re.search(r"\bmodule\s+(\w+)\s*$", slip.before)
    if slip.found != "(" or name is None:
        return None
    return f"inputs are declared inside: `module {name[1]} {{ input NAME : TYPE ... }}`"


def _derived_in_network(slip: Slip) -> str | None:
    name = re.search(r"([\w.]+)\s*$", slip.before)
    if slip.head != "network" or slip.found != "(" or name is None:
        return None
    if re.match(r"\s*(?:\w+\s*=|\)|\d)", slip.after) is None:
        return None
    return f"derive it above the network, `module NAME = {name[1]}(...)`, and wire `NAME`"


def _list(slip: Slip) -> str | None:
    if slip.found != "[" or "NUMBER" not in slip.accepted or "LSQB" in slip.accepted:
        return None
    if re.match(r"[^\[\]]*\sfor\s", slip.after):
        return "a reduction has no brackets: `min(r for r in ranges)`"
    return "there are no lists of values: arrays are sensors, slices of them, and what is computed from them"


def _loop_variables(slip: Slip) -> str | None:
    if slip.found != "(" or not re.search(r"\bfor\s+$", slip.before):
        return None
    return "variables have no parentheses: `for r, a in ranges`"


def _loop_condition(slip: Slip) -> str | None:
    is_condition = slip.found in ("where", "when") and {"IF", "RPAR"} <= slip.accepted
    return "write `if`" if is_condition else None


_SENSOR_PARTS = ("bearing", "range", "default", "from", "within")


def _sensor_order(slip: Slip) -> str | None:
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


def _robot_import(slip: Slip) -> str | None:
    if not re.search(r"\bimport\s+robot\s+$", slip.before):
        return None
    if slip.found.startswith('"'):
        return "`import robot` takes no name: choose the robot with --robot NAME, or in colony.toml"
    return "`import robot` takes no alias: the robot's names have no prefix" if slip.found == "as" else None


def _contract_condition(slip: Slip) -> str | None:
    if slip.head != "contract" or slip.found not in ("when", "if") or "IMPLIES" not in slip.accepted:
        return None
    condition = re.match(r"[ \t]*([^\r\n#]{1,40}?)[ \t]*(?:[\r\n#]|$)", slip.after)
    return f"write the condition first: `{condition[1] if condition else 'CONDITION'} implies ...`"


_FORMS: tuple[Callable[[Slip], str | None], ...] = (
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
)
