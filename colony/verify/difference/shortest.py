"""A run that breaks a claim: one that is drawn shows that there is one, a search looks for a shorter one."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from colony.ir.program import Program
from colony.verify.contracts.minimize import minimal
from colony.verify.contracts.refute import Refuter
from colony.verify.contracts.replay import Replay
from colony.verify.contracts.results import Options, Trace
from colony.verify.contracts.search import Search
from colony.verify.contracts.setting import Setting
from colony.verify.contracts.solver import Budget
from colony.verify.difference.sampling import frames
from colony.verify.symbolic.encode import encode

_SEED, _RUNS, _FRAMES = 0, 10, 30


def drawn(program: Program, contract: str) -> Trace | None:
    """A run that breaks the contract among some drawn at random, made as short as it goes.

    Whatever the modules in Python would answer: none is asked in it.
    """
    replay, random = Replay(program, contract, unasked=True), Random(_SEED)
    for _ in range(_RUNS):
        snapshots = tuple(frames(program, random, _FRAMES))
        if replay.breaks(snapshots):
            return minimal(replay, snapshots)
    return None


def shortest(
    program: Program, contract: str, known: Trace, options: Options, clock: Callable[[], float]
) -> Trace:
    """A run that breaks the contract with no more frames than `known`, which does, has; fewer if the search
    finds that they do within its budget.
    """
    if len(known.snapshots) == 1:
        return known
    setting, budget = Setting(encode(program)), Budget(options, clock)
    search = Search(setting.cones[contract], setting.claims[contract], budget)
    refuter = Refuter(program, contract)
    for _ in range(len(known.snapshots) - 1):
        for candidate in search.longer(asked=False):
            trace = refuter.believe(candidate, search)
            if trace is not None:
                return trace
            if not refuter.patient(candidate):
                break
        if budget.spent():
            break
    return known
