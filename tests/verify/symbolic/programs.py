"""Programs and questions that several tests of formulas use."""

from __future__ import annotations

import z3

from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.verify.symbolic.system import ContractFormula, System
from colony.verify.symbolic.unrolling import Unrolling, cone

ROBOT = """
robot r {
  sensor a : mm                        from DServer.a
  sensor x : mm range 0 .. 1000        from DServer.x
  sensor s[5] : mm range 0 .. 1000     from DServer.s
  sensor p : bool                      from DServer.p
  sensor q : bool default true         from DServer.q
  actuator drive { v : mm/s range -600 .. 500 } to RServer.drive idle drive(v = 0)
  actuator light { level : number } to DServer.light idle hold
}
"""


def program(text: str) -> Program:
    return load_text(ROBOT + text)


def broken(system: System, name: str, frames: int = 1, initial: bool = False) -> z3.Solver:
    """A solver that asks for frames of which the last breaks a contract, from any state or the first."""
    claim = claim_of(system, name)
    unrolling = Unrolling(system, cone(system, (claim.holds,)))
    solver = z3.Solver()
    solver.set("timeout", 10_000)
    solver.add(*(unrolling.initial() if initial else unrolling.invariants(0)))
    for i in range(frames - 1):
        solver.add(*unrolling.step(i))
    last = frames - 1
    solver.add(*unrolling.frame(last))
    solver.add(z3.Not(unrolling.at(last, claim.holds)))
    return solver


def claim_of(system: System, name: str) -> ContractFormula:
    return next(c for c in system.claims if c.name == name)
