"""Seeded networks of any size, for benchmarks and tests: random graphs, ladders and chains.

All are programs, so that they go through every pass; each wire has one node, as in a large hand-written file.
"""

from __future__ import annotations

from random import Random
from typing import Literal

from colony.ir.expression import Constant
from colony.ir.program import (
    Actuator,
    ActuatorField,
    Chain,
    Module,
    Program,
    Robot,
    TransferFunction,
    Use,
    Wire,
    Wiring,
)
from colony.ir.types import BOOL, DIMENSIONLESS

Relation = Literal["suppresses", "inhibits"]

INHIBITORS_OVER_MODULES = 0.3  # by how likely a module inhibits what it meets: 20 % of all nodes
INHIBITORS_OVER_WIRES = 0.02  # few wires inhibit, or chance would decide how much of a large network commands
FAN_OUT = 0.1
WINDOWS = 0.1
DEEPEST = 10_000


def random_program(size: int, seed: int) -> Program:
    """`size` modules under one actuator: a random graph, 20 % inhibitors, 10 % of wires used again.

    Every other node goes on from the one before, up to `DEEPEST` nodes deep; the others join any two wires.
    Inhibitors have the shallower wire as the dominant one. One node in ten has a time constant.
    """
    random = Random(seed)
    pool = [(f"m{i}", 0) for i in range(size)]
    spine = _draw(pool, random)
    wires: list[Wire] = []
    while pool:
        other = _draw(pool, random)
        along = not pool or (spine[1] < DEEPEST and random.random() < 0.5)
        one = spine if along else _draw(pool, random)
        if random.random() < FAN_OUT:
            pool.append(other)
        wire, depth = f"w{len(wires)}", 1 + max(_depth(one), _depth(other))
        wires.append(Wire(name=wire, wiring=_any_node(one, other, random)))
        if along:
            spine = (wire, depth)
        else:
            pool.append((wire, depth))
    return driven(size, wires, spine[0])


def _any_node(one: tuple[str, int], other: tuple[str, int], random: Random) -> Chain:
    one, other = sorted((one, other), key=_depth)
    likely = INHIBITORS_OVER_WIRES if _depth(one) else INHIBITORS_OVER_MODULES
    relation: Relation = "inhibits" if random.random() < likely else "suppresses"
    if relation == "suppresses" and random.random() < 0.5:
        one, other = other, one
    window_ns = random.randrange(1, 20) * 50_000_000 if random.random() < WINDOWS else 0
    return joined(one[0], other[0], relation, window_ns)


def ladder(rungs: int) -> Program:
    """`w' = (x inhibits w) suppresses w`, `rungs` times: 2 ** rungs ways to the lowest module."""
    wires: list[Wire] = []
    name = "m0"
    for i in range(1, rungs + 1):
        inhibited = joined(f"m{i}", name, "inhibits")
        wiring = Chain(relation="suppresses", operands=(inhibited, Use(name=name)), windows_ns=(0,))
        name = f"w{i}"
        wires.append(Wire(name=name, wiring=wiring))
    return driven(rungs + 1, wires, name)


def chain(size: int) -> Program:
    """`m0 suppresses m1 suppresses ...`, all in one wire."""
    wiring = Chain(
        relation="suppresses",
        operands=tuple(Use(name=f"m{i}") for i in range(size)),
        windows_ns=(0,) * (size - 1),
    )
    return driven(size, [Wire(name="all", wiring=wiring)], "all")


def joined(dominant: str, inferior: str, relation: Relation, window_ns: int = 0) -> Chain:
    """One node over two named wires."""
    operands = (Use(name=dominant), Use(name=inferior))
    return Chain(relation=relation, operands=operands, windows_ns=(window_ns,))


def driven(size: int, wires: list[Wire], root: str) -> Program:
    """A program of modules m0 .. m<size - 1>, in which the wire `root` drives the actuator `drive`."""
    drive = Actuator(
        name="drive",
        fields=(ActuatorField(name="velocity", type=DIMENSIONLESS),),
        server="RServer",
        command="drive",
        idle=(0.0,),
    )
    command = TransferFunction(actuator="drive", fields=(Constant(type=DIMENSIONLESS, value=0.0),))
    when = Constant(type=BOOL, value=True)
    output: Wiring = Use(name=root)
    return Program(
        robot=Robot(name="rome", actuators=(drive,)),
        modules=tuple(Module(name=f"m{i}", when=when, command=command) for i in range(size)),
        wires=(*wires, Wire(name="drive", wiring=output, actuator="drive")),
    )


def _depth(wire: tuple[str, int]) -> int:
    return wire[1]


def _draw(pool: list[tuple[str, int]], random: Random) -> tuple[str, int]:
    """Take any one out, in constant time."""
    at = random.randrange(len(pool))
    pool[at], pool[-1] = pool[-1], pool[at]
    return pool.pop()
