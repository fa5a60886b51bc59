"""Encoding of a program as a transition system: one frame, in the order in which the language computes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import assert_never

import z3

from colony.ir import program as ir
from colony.ir.program import Contract, Program
from colony.ir.types import Bool, Enum, Quantity
from colony.verify.symbolic.builder import SymbolicValues, SystemBuilder
from colony.verify.symbolic.expressions import ExpressionEncoder
from colony.verify.symbolic.inputs import begin, bounds_of, enumerator_input, finite_input, sense
from colony.verify.symbolic.logic import FALSE, TRUE, both, either, negation
from colony.verify.symbolic.modules import ContractEncoder, DeclarationEncoder
from colony.verify.symbolic.network import ActiveLimit, NetworkEncoder, limits, send
from colony.verify.symbolic.shapes import with_stable_shapes
from colony.verify.symbolic.system import (
    ActuatorTerms,
    ContractFormula,
    Disturbance,
    DisturbanceInputs,
    Fact,
    FactKind,
    Graph,
    ModuleTerms,
    OutsideInput,
    PythonInput,
    Scalar,
    SensorInput,
    Shape,
    System,
)
from colony.verify.symbolic.unrolling import reasons_of

_NONE: Mapping[str, Shape] = {}


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameParts:
    """The parts of an encoded frame."""

    frame_values: SymbolicValues
    sensors: Mapping[str, SensorInput]
    modules: Mapping[str, ModuleTerms]
    python: Mapping[str, PythonInput]
    bounds: Sequence[ActiveLimit]
    actuators: Mapping[str, ActuatorTerms]
    claims: tuple[ContractFormula, ...]


def encode(
    program: Program,
    precise: bool = False,
    known: Mapping[str, Shape] = _NONE,
    guess: Mapping[str, Shape] = _NONE,
) -> System:
    """Return one frame of `program` as a transition system.

    With `precise`, products and quotients of variables are encoded exactly, which z3 often cannot decide; by
    default only their signs and bounds are. `known` are shapes of memory that every frame preserves, `guess`
    those that it may preserve.
    """

    def encode_with(shapes: Mapping[str, Shape]) -> tuple[SystemBuilder, System]:
        builder = SystemBuilder(precise=precise, shapes=dict(shapes))
        return builder, system_of(program, builder, encode_frame(program, builder))

    return with_reasons(with_stable_shapes(encode_with, known, guess))


class OpenEncoding:
    """A frame of a program, to which claims are added when they are first asked. Mutable.

    A claim has no memory of its own. `guess` are shapes of memory that every frame may preserve. `system` has
    the facts of all claims added so far, but not the claims.
    """

    def __init__(self, program: Program, guess: Mapping[str, Shape] = _NONE) -> None:
        encodings: list[tuple[SystemBuilder, FrameParts, System]] = []

        def encode_with(shapes: Mapping[str, Shape]) -> tuple[SystemBuilder, System]:
            builder = SystemBuilder(precise=False, shapes=dict(shapes))
            parts = encode_frame(program, builder)
            encodings.append((builder, parts, system_of(program, builder, parts)))
            return builder, encodings[-1][2]

        stable = with_stable_shapes(encode_with, guess=guess)
        self._builder, parts, _ = next(x for x in encodings if x[2] is stable)
        self._frame_values = parts.frame_values
        self._facts = dict(stable.facts)
        self._fact_count = len(self._builder.facts)
        self.system = replace(stable, facts=self._facts)

    def claim(self, contract: Contract) -> ContractFormula:
        """Return a contract as a claim about the frame, without its reasons."""
        claim = contract_claim(contract, self._builder, self._frame_values)
        assert len(self._builder.cells) == len(self.system.cells), "the claim has memory"
        for fact in self._builder.facts[self._fact_count :]:
            key = fact.subject.get_id()
            self._facts[key] = (*self._facts.get(key, ()), fact)
        self._fact_count = len(self._builder.facts)
        return claim


def encode_frame(program: Program, builder: SystemBuilder) -> FrameParts:
    """Encode one frame of `program`, contracts included."""
    frame_values = begin(program.robot, builder)
    sensors = sense(program, builder, frame_values)
    encoder = DeclarationEncoder(program, builder, frame_values)
    encoder.encode_states()
    encoder.encode_derived()
    modules, python = encoder.encode_modules()
    NetworkEncoder(program, builder, frame_values).encode_wires()
    bounds = limits(program, builder, frame_values)
    actuators = {a.name: send(a, modules, bounds, builder, frame_values) for a in program.robot.actuators}
    return FrameParts(
        frame_values=frame_values,
        sensors=sensors,
        modules=modules,
        python=python,
        bounds=bounds,
        actuators=actuators,
        claims=tuple(contract_claim(c, builder, frame_values) for c in program.contracts),
    )


def system_of(program: Program, builder: SystemBuilder, parts: FrameParts) -> System:
    """Return the transition system of a frame that was encoded with `builder`."""
    frame_values = parts.frame_values
    return System(
        program=program,
        now=frame_values.now,
        begun=frame_values.begun,
        last=frame_values.last,
        restarted=frame_values.restarted,
        sensors=parts.sensors,
        python=parts.python,
        cells=tuple(builder.cells),
        assumptions=tuple(f.formula for f in builder.facts if f.kind is FactKind.ASSUMPTION),
        definitions=tuple(f.formula for f in builder.facts if f.kind is FactKind.DEFINITION),
        invariants=tuple(f.formula for f in builder.facts if f.kind is FactKind.INVARIANT),
        auxiliaries=tuple(builder.auxiliaries),
        facts=by_constant(builder.facts),
        inexact=builder.inexact,
        graph=Graph(builder.cells),
        derived=frame_values.derived,
        states=frame_values.states,
        locals={name: value for name, (_, value) in frame_values.locals.items()},
        modules=parts.modules,
        active=frame_values.active,
        actuators=parts.actuators,
        claims=parts.claims,
        shapes=builder.shapes,
        written={name: new for name, (_, _, new) in builder.numbers_in_memory.items()},
    )


def contract_claim(
    contract: Contract, builder: SystemBuilder, frame_values: SymbolicValues, name: str | None = None
) -> ContractFormula:
    """Encode a contract as a claim, called as the contract unless `name` is given."""
    name = contract.name if name is None else name
    expressions = ExpressionEncoder(
        builder=builder, frame_values=frame_values, advances=TRUE, hint=f"contract {name}"
    )
    holds = ContractEncoder(expressions=expressions).holds(contract.expression)
    return ContractFormula(name=name, holds=holds, span=contract.span)


def by_constant(facts: Sequence[Fact]) -> dict[int, tuple[Fact, ...]]:
    """Group facts by the id of their subject."""
    groups: dict[int, list[Fact]] = {}
    for fact in facts:
        groups.setdefault(fact.subject.get_id(), []).append(fact)
    return {key: tuple(group) for key, group in groups.items()}


def with_reasons(system: System) -> System:
    """Return `system` with the reasons of all inexact terms that each claim depends on."""
    claims = (replace(c, inexact=reasons_of(system, c.holds)) for c in system.claims)
    return replace(system, claims=tuple(claims))


# --- disturbing ---------------------------------------------------------------------------------------
#
# A program whose actuators are not always given what the network decides, as a transition system.
#
# It extends the system of `encode.py`: memory of the program and the network's decisions are the same terms,
# so what was proved of them holds in it as well. To these it adds, for each disturbance
# (`system.Disturbance`), what each actuator is given, and once more each contract, about that. Only memory of
# contracts, of held values, and of the network where clients can be lost, depends on a disturbance.


def claim_name(contract: str, disturbance: Disturbance) -> str:
    """Return the name of a contract's claim under a disturbance; names of contracts have no blanks."""
    return f"{contract} {disturbance.value}"


def encode_disturbed(usual: System) -> System:
    """Return `usual`, of `encode`, extended by all disturbances; `inexact` of its claims is left empty."""
    program = usual.program

    def encode_with(shapes: Mapping[str, Shape]) -> tuple[SystemBuilder, System]:
        builder = SystemBuilder(precise=False, shapes=dict(shapes))
        parts = encode_frame(program, builder)
        claims, inputs = list(parts.claims), {}
        for disturbance in Disturbance:
            inputs[disturbance], more = _disturbed(program, builder, parts, disturbance)
            claims += more
        system = system_of(program, builder, replace(parts, claims=tuple(claims)))
        return builder, replace(system, disturbances=inputs)

    return with_stable_shapes(encode_with, usual.shapes)


def _disturbed(
    program: ir.Program, builder: SystemBuilder, parts: FrameParts, disturbance: Disturbance
) -> tuple[DisturbanceInputs, list[ContractFormula]]:
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
    program: ir.Program, builder: SystemBuilder, usual: SymbolicValues, inputs: DisturbanceInputs
) -> SymbolicValues:
    """Return the values of a frame before its decisions, without the modules that are lost."""
    frame_values = replace(usual, active=dict(usual.active), wins=dict(usual.wins), commanded={}, sent={})
    if inputs.lost:
        for module, lost in inputs.lost.items():
            frame_values.active[module] = both(usual.active[module], negation(lost))
        NetworkEncoder(program, builder, frame_values).encode_wires()
    return frame_values


def _inputs(
    program: ir.Program, builder: SystemBuilder, disturbance: Disturbance, label: str
) -> DisturbanceInputs:
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


def _outside(actuator: ir.Actuator, builder: SystemBuilder, label: str) -> OutsideInput:
    fields = tuple(_field(f"{actuator.name}.{f.name} commanded{label}", f, builder) for f in actuator.fields)
    return OutsideInput(commands=z3.Bool(f"{actuator.name} commanded{label}"), fields=fields)


def _field(name: str, field: ir.ActuatorField, builder: SystemBuilder) -> Scalar:
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
