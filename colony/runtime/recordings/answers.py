"""The recorded answers of modules in Python, so that readers of a recording need not run the modules.

    {"seeks": {"command": [300.0, -2.5]}, "rests": {}, "fails": {"error": true, "blind": true}}

`command` has the fields in their declared order, in base units (mm, s, deg), as the module answered; it is
absent if the module was not applicable, or had no answer (`blind`). A module whose answer is unknown is
absent.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Literal

import msgspec

from colony.ir.frame import Answer
from colony.ir.program import Program
from colony.ir.types import Bool


class AnswerMessage(msgspec.Struct, frozen=True, kw_only=True):
    """An answer in its recorded form; strings stand for values that JSON numbers cannot represent."""

    command: tuple[float | bool | Literal["nan", "inf", "-inf"], ...] | None = None
    error: bool = False
    blind: bool = False


def answers_text(answers: Mapping[str, Answer]) -> str:
    """Return the JSON object of the answers of a frame."""
    return json.dumps({module: _members(answer) for module, answer in answers.items()})


def _members(answer: Answer) -> dict[str, object]:
    members: dict[str, object] = {} if answer.values is None else {"command": [*map(_value, answer.values)]}
    flags = {"error": answer.error, "blind": answer.blind}
    return {**members, **{name: True for name, is_set in flags.items() if is_set}}


def _value(x: float | bool) -> float | bool | str:
    return x if math.isfinite(x) else repr(x)


def read_answers(recorded: Mapping[str, AnswerMessage], program: Program) -> dict[str, Answer]:
    """Return the recorded answers of a frame.

    Raises:
        ValueError: a module of the program does not command these fields.
    """
    answers = {
        module: Answer(_values(message), message.error, message.blind) for module, message in recorded.items()
    }
    fields = {actuator.name: actuator.fields for actuator in program.robot.actuators}
    for module in program.modules if answers else ():
        values = answers[module.name].values if module.name in answers else None
        expected = [isinstance(f.type, Bool) for f in fields.get(module.actuator or "", ())]
        if values is not None and [isinstance(x, bool) for x in values] != expected:
            raise ValueError(f"the answer of `{module.name}` does not have the fields of its actuator")
    return answers


def _values(recorded: AnswerMessage) -> tuple[float | bool, ...] | None:
    if recorded.command is None:
        return None
    return tuple([float(x) if isinstance(x, str) else x for x in recorded.command])
