"""What an operation refers to must be there, and give what its kind says."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.execute.code import (
    Code,
    Commanded,
    Kind,
    Literal,
    OldCell,
    Op,
    PythonActive,
    PythonField,
    SensorElement,
    SensorFresh,
    Sent,
    Winner,
)
from colony.execute.compiled import Compiled
from colony.execute.validity import MAX_TIME_NS, InvalidProgramError, check
from colony.ir.walk import InTime
from tests.programs import compilation, robot

TEXT = f"""{robot()}
module m {{ when recently(a, 1 s) do out(v = four[0]) }}
module p from python "tests.drawn.python_modules:ErraticModule" {{
  param seed = 1 reads a commands base rate 1 s
}}
network {{ out = m  base = p }}
contract c: out.v < 5
"""


@pytest.fixture(scope="module")
def compiled() -> Compiled:
    return compilation(TEXT).compiled


def with_one_more(compiled: Compiled, op: Op, kind: Kind) -> tuple[Compiled, int]:
    """Return the program with an operation at its end that nothing refers to, and its number."""
    code: Code = compiled.code
    code = replace(code, ops=(*code.ops, op), kinds=(*code.kinds, kind))
    return replace(compiled, code=code), len(code.ops) - 1


@pytest.mark.parametrize(
    ("good", "kind", "bad"),
    [
        (SensorFresh("x"), Kind.BOOL, SensorFresh("nobody")),
        (SensorElement("x", 0), Kind.NUMBER, SensorElement("x", 1)),
        (SensorElement("four", 3), Kind.NUMBER, SensorElement("four", 4)),
        (SensorElement("bits", 0), Kind.BOOL, SensorElement("bits", -1)),
        (SensorElement("x", 0), Kind.NUMBER, SensorElement("nobody", 0)),
        (PythonActive("p"), Kind.BOOL, PythonActive("m")),
        (PythonField("p", 1), Kind.NUMBER, PythonField("p", 2)),
        (PythonField("p", 0), Kind.NUMBER, PythonField("m", 0)),
        (Winner("out", "m"), Kind.BOOL, Winner("nobody", "m")),
        (Commanded("out"), Kind.BOOL, Commanded("nobody")),
        (Sent("out", 0), Kind.NUMBER, Sent("out", 1)),
        (Sent("base", 1), Kind.NUMBER, Sent("nobody", 0)),
        (Literal(MAX_TIME_NS), Kind.TIME, Literal(MAX_TIME_NS + 1)),
        (Literal(-MAX_TIME_NS), Kind.TIME, Literal(-MAX_TIME_NS - 1)),
        (OldCell(0), Kind.TIME, OldCell(-1)),
    ],
)
def test_what_an_operation_refers_to_is_there(compiled: Compiled, good: Op, kind: Kind, bad: Op) -> None:
    check(with_one_more(compiled, good, kind)[0])
    forged, at = with_one_more(compiled, bad, kind)
    with pytest.raises(InvalidProgramError, match=rf"^operation {at} \({type(bad).__name__}\) is malformed$"):
        check(forged)


def test_a_contract_in_time_names_actuators(compiled: Compiled) -> None:
    [contract] = compiled.code.contracts
    for name in ("out", "nobody"):
        named = replace(contract, in_time=InTime(actuators=(name,), remembers=False))
        changed = replace(compiled, code=replace(compiled.code, contracts=(named,)))
        if name == "out":
            check(changed)
        else:
            with pytest.raises(InvalidProgramError, match="c names no actuator"):
                check(changed)


def test_what_depends_on_decisions_stands_behind_them(compiled: Compiled) -> None:
    for op in (Winner("out", "m"), Commanded("out"), Sent("out", 0)):
        kind = Kind.NUMBER if isinstance(op, Sent) else Kind.BOOL
        forged, at = with_one_more(compiled, op, kind)
        early = replace(forged, code=replace(forged.code, decided=at + 1))
        with pytest.raises(InvalidProgramError, match=r"is malformed$"):
            check(early)
