"""A program whose actuators are not always given what the network decides, as a transition system.

It extends the system of `encode.py`: memory of the program and the network's decisions are the same terms, so
what was proved of them holds in it as well. To these it adds, for each disturbance (`system.Disturbance`),
what each actuator is given, and once more each contract, about that. Only memory of contracts, of held
values, and of the network where clients can be lost, depends on a disturbance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import assert_never

import z3

from colony.ir import program as ir
from colony.ir.types import Bool, Enum, Quantity
from colony.verify.symbolic.builder import Builder
from colony.verify.symbolic.encode import (
    FrameParts,
    contract_claim,
    encode_frame,
    system_of,
)
from colony.verify.symbolic.frame_values import FrameValues
from colony.verify.symbolic.inputs import bounds_of, enumerator_input, finite_input
from colony.verify.symbolic.logic import FALSE, both, either, negation
from colony.verify.symbolic.network import NetworkEncoder
from colony.verify.symbolic.sending import send
from colony.verify.symbolic.shapes import with_stable_shapes
from colony.verify.symbolic.system import (
    Claim,
    Disturbance,
    DisturbanceInputs,
    OutsideInput,
    Scalar,
    Shape,
    System,
)


def claim_name(contract: str, disturbance: Disturbance) -> str:
    """Return the name of a contract's claim under a disturbance; names of contracts have no blanks."""
    return f"{contract} {disturbance.value}"


def encode_disturbed(usual: System) -> System:
    """Return `usual`, of `encode`, extended by all disturbances; `inexact` of its claims is left empty."""
    program = usual.program

    def encode_with(shapes: Mapping[str, Shape]) -> tuple[Builder, System]:
        builder = Builder(precise=False, shapes=dict(shapes))
        parts = encode_frame(program, builder)
        claims, inputs = list(parts.claims), {}
        for disturbance in Disturbance:
            inputs[disturbance], more = _disturbed(program, builder, parts, disturbance)
            claims += more
        system = system_of(program, builder, replace(parts, claims=tuple(claims)))
        return builder, replace(system, disturbances=inputs)

    return with_stable_shapes(encode_with, usual.shapes)


def _disturbed(
    program: ir.Program, builder: Builder, parts: FrameParts, disturbance: Disturbance
) -> tuple[DisturbanceInputs, list[Claim]]:
    """Encode a disturbance, and each contract under it."""
    label = f" {disturbance.value}"
    inputs = _inputs(program, builder, disturbance, label)
    frame_values = _network(program, builder, parts.frame_values, inputs)
    for actuator in program.robot.actuators:
        outside = inputs.outside.get(actuator.name)
        idle = inputs.idle[actuator.name]
        commands = FALSE if outside is None else both(outside.commands, negation(idle))
        undisturbed = negation(idle if outside is None else either(idle, outside.commands))
        wins = frame_values.wins[actuator.name]
        frame_values.wins[actuator.name] = {m: both(w, undisturbed) for m, w in wins.items()}
        effective = None if outside is None else replace(outside, commands=commands)
        send(actuator, parts.modules, parts.bounds, builder, frame_values, effective, label)
    claims = [
        contract_claim(c, builder, frame_values, claim_name(c.name, disturbance)) for c in program.contracts
    ]
    return inputs, claims


def _network(
    program: ir.Program, builder: Builder, usual: FrameValues, inputs: DisturbanceInputs
) -> FrameValues:
    """Return the values of a frame before its decisions, without the modules that are lost."""
    frame_values = replace(usual, active=dict(usual.active), wins=dict(usual.wins), commanded={}, sent={})
    if inputs.lost:
        for module, lost in inputs.lost.items():
            frame_values.active[module] = both(usual.active[module], negation(lost))
        NetworkEncoder(program, builder, frame_values).encode_wires()
    return frame_values


def _inputs(program: ir.Program, builder: Builder, disturbance: Disturbance, label: str) -> DisturbanceInputs:
    """Return free inputs of a disturbance."""
    actuators = program.robot.actuators
    outside = {}
    if disturbance is Disturbance.OPERATORS:
        outside = {a.name: _outside(a, builder, label) for a in actuators}
    return DisturbanceInputs(
        idle={a.name: z3.Bool(f"{a.name} idle{label}") for a in actuators},
        lost={m: z3.Bool(f"{m} lost{label}") for m in ir.modules_that_can_be_lost(program)},
        outside=outside,
    )


def _outside(actuator: ir.Actuator, builder: Builder, label: str) -> OutsideInput:
    fields = tuple(_field(f"{actuator.name}.{f.name} commanded{label}", f, builder) for f in actuator.fields)
    return OutsideInput(commands=z3.Bool(f"{actuator.name} commanded{label}"), fields=fields)


def _field(name: str, field: ir.ActuatorField, builder: Builder) -> Scalar:
    """Return an arbitrary finite field within its range."""
    match field.type:
        case Bool():
            return z3.Bool(name)
        case Enum():
            return enumerator_input(name, field.type, builder)
        case Quantity():
            return finite_input(name, bounds_of(field.low, field.high), builder)
        case _:
            assert_never(field.type)
