"""Small behaviors to prove things of."""

from __future__ import annotations

from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.results import (
    OverReals,
    ProofOptions,
    Proved,
    ProvedInTime,
    Refuted,
    Result,
    Unknown,
)

ROBOT = """
enum goal { none = 0, corner = 67, light = 76 }
robot r {
  sensor x       : number              from PServer.x
  sensor y       : number              from PServer.y
  sensor small   : number range 0 .. 1 from PServer.small
  sensor far     : m range 0 .. 10     from PServer.far
  sensor slope   : deg                 from PServer.slope
  sensor rays[6] : m range 0 .. 10     from PServer.rays
  sensor bump    : bool                from RServer.bump
  sensor stop    : bool default false  from RServer.stop
  sensor want    : goal                from DServer.want
  actuator drive { velocity : m/s range -1 .. 1, turn : deg/s }
           to RServer.drive idle drive(velocity = 0, turn = 0)
}
module back   { when recently(bump, 2 s) do drive(velocity = -0.5 m/s, turn = 0) }
module cruise { when far > 1 m       do drive(velocity = 0.5 m/s, turn = 0) }
network { drive = back suppresses[300 ms] cruise }
"""


MEAN = """
state mean = 0
next mean = mean + (clamp(value_or(x, 0), 0, 10) - mean) / 4
"""
"""A mean that comes close to 10 and never gets there: over reals, and in all floats that were tried."""


def program(text: str) -> Program:
    """A program with this text after the declarations above."""
    return load_text(ROBOT + text)


def result(text: str, options: ProofOptions | None = None) -> Result:
    """What becomes of the last contract of a text."""
    return prove_contracts(program(text), options)[-1]


def proved(text: str, options: ProofOptions | None = None) -> Proved:
    """What is proved of it while no client is late, for floats or over reals."""
    found = result(text, options)
    if isinstance(found, OverReals):
        return found.in_time
    if isinstance(found, ProvedInTime):
        found = found.in_time
    assert isinstance(found, Proved), found
    return found


def refuted(text: str, options: ProofOptions | None = None) -> Refuted:
    found = result(text, options)
    assert isinstance(found, Refuted), found
    return found


def unknown(text: str, options: ProofOptions | None = None) -> Unknown:
    found = result(text, options)
    assert isinstance(found, Unknown), found
    return found
