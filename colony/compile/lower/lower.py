"""Lowering: from the typed program and its clients to the compiled program, with all of its code.

Everything is lowered on first use, beginning with the decisions, so that the code of one client contains only
what that client needs. Nothing recurses over chains of lets, wires or guards.
"""

from __future__ import annotations

from dataclasses import replace
from typing import assert_never

from colony.compile.clients import Client, ClientList
from colony.compile.lower.contracts import ContractLowering
from colony.compile.lower.declarations import Declarations
from colony.compile.lower.expressions import Scope, kind_of
from colony.compile.lower.guards import GuardLowering
from colony.execute.code import (
    ActuatorCode,
    ClientCode,
    Code,
    ContractCode,
    Kind,
    LimitCode,
    Lost,
    PythonCall,
    PythonField,
    PythonRead,
)
from colony.execute.compiled import Compiled
from colony.execute.operators import Operator
from colony.execute.views import trimmed
from colony.ir import program as ir
from colony.ir.in_time import in_time
from colony.ir.types import Array


def lower(program: ir.Program, clients: ClientList, traversal: ClientList | None = None) -> Compiled:
    """Lower all of a program: every actuator with all of its clients, every Python module, the contracts.

    Near-linear in the size of the program and its clients.

    Args:
        program: the program.
        clients: its clients.
        traversal: its clients before simplification; `clients` by default.
    """
    lowering = _Lowering(program, clients)
    for module in program.modules:
        if isinstance(module, ir.PythonModule):
            lowering.python_module(module)
    by_actuator = {a.actuator: a.clients for a in clients.actuators}
    for actuator in program.robot.actuators:
        lowering.actuator(actuator, by_actuator.get(actuator.name, ()))
    lowering.states()
    lowering.decided = len(lowering.builder.ops)
    lowering.contracts()
    lowering.states()
    lowering.variants(clients, traversal or clients)
    lowering.states()
    code, robot = trimmed(lowering.code(), every_sensor=True), program.robot
    return Compiled(name=robot.name, frame_ns=robot.frame_ns, code=code)


class _Lowering(Declarations):
    """A program being lowered to one `Code`. Mutable."""

    def __init__(self, program: ir.Program, clients: ClientList) -> None:
        super().__init__(program, clients)
        self.decided = 0
        self._lowered_contracts = ContractLowering(self.expressions, self)
        self._python: list[PythonCall] = []
        self._actuator_codes: list[ActuatorCode] = []
        self._contracts: list[ContractCode] = []

    def code(self) -> Code:
        return Code(
            ops=tuple(self.builder.ops),
            kinds=tuple(self.builder.kinds),
            decided=self.decided,
            sensors=self.program.robot.sensors,
            cells=self.builder.cells(),
            python=tuple(self._python),
            actuators=tuple(self._actuator_codes),
            contracts=tuple(self._contracts),
            names=self.builder.names,
            memory_cells=self.builder.places,
        )

    # --- Python modules --------------------------------------------------------------------------

    def python_module(self, module: ir.PythonModule) -> None:
        """Lower the readings of a Python module, and record its call."""
        reads = [r.expression for r in module.reads]
        self.prepare(*reads)
        scope = self.file_scope(module.name, tuple(reads))
        call = PythonCall(
            module=module.name,
            module_path=module.module_path,
            class_name=module.class_name,
            params=module.params,
            present=scope.ready,
            reads=tuple(self._read(reading, scope) for reading in module.reads),
            fields=self.actuators[module.actuator].fields if module.actuator else (),
            rate_ns=module.rate_ns,
            span=module.span,
        )
        self._python.append(call)

    def _read(self, reading: ir.PythonReading, scope: Scope) -> PythonRead:
        elements = self.expressions.lower(reading.expression, scope)
        return PythonRead(
            name=reading.name, elements=elements, array=isinstance(reading.expression.type, Array)
        )

    # --- actuators and contracts -----------------------------------------------------------------

    def actuator(self, actuator: ir.Actuator, clients: tuple[Client, ...]) -> None:
        self._actuator_codes.append(
            ActuatorCode(
                actuator=actuator,
                clients=tuple(self._client(client) for client in clients),
                limits=tuple(
                    self._limit(i, limit)
                    for i, limit in enumerate(self.program.limits)
                    if limit.actuator == actuator.name
                ),
            )
        )

    def _command(self, name: str) -> tuple[int, ...]:
        module = self.modules[name]
        match module:
            case ir.Module(command=command):
                assert command is not None, "a client's module commands its actuator"
                self.prepare(*command.fields)
                scope = self.module_scope(module, name)
                return tuple(self.expressions.scalar(field, scope) for field in command.fields)
            case ir.PythonModule(actuator=actuator):
                assert actuator is not None, "a client's module commands its actuator"
                fields = self.actuators[actuator].fields
                return tuple(
                    self.builder.add(PythonField(name, i), kind_of(f.type)) for i, f in enumerate(fields)
                )
            case _:
                assert_never(module)

    def _client(self, client: Client) -> ClientCode:
        guard, exclusive = self.guards.guard(client.guard), self.guards.guard(client.exclusive)
        module = self.modules[client.module]
        match module:
            case ir.Module():
                present = self.module_present(module.name)
            case ir.PythonModule():
                present = self.module_active(module.name)
            case _:
                assert_never(module)
        return ClientCode(
            module=client.module,
            priority=client.priority,
            present=present,
            known=self.module_known(client.module),
            active=self.module_active(client.module),
            guard=guard,
            exclusive=exclusive,
            fields=self._command(client.module),
            loss_aware_guard=guard,
            loss_aware_exclusive=exclusive,
            unsimplified=guard,
            has_several_paths=client.has_several_paths,
            span=module.span,
        )

    def _limit(self, number: int, limit: ir.Limit) -> LimitCode:
        builder = self.builder
        name = f"limit {number}"
        self.prepare(limit.bound)
        bound_scope = self.file_scope(f"{name} bound", (limit.bound,))
        bound = self.expressions.scalar(limit.bound, bound_scope)
        missing = [builder.negation(bound_scope.ready)]
        condition = builder.literal(True)
        if limit.condition is not None:
            self.prepare(limit.condition)
            condition_scope = self.file_scope(f"{name} condition", (limit.condition,))
            condition = self.expressions.scalar(limit.condition, condition_scope)
            missing.append(builder.negation(condition_scope.ready))
        sound = builder.both(bound_scope.ready, builder.apply(Operator.FINITE, bound))
        idle = self.actuators[limit.actuator].idle
        if idle is not None:
            bound = builder.apply(Operator.SELECT, sound, bound, builder.literal(idle[limit.field_index]))
        return LimitCode(
            field_index=limit.field_index,
            relation=limit.relation,
            applies=builder.either(*missing, condition),
            bound=bound,
            known=sound if idle is None else builder.literal(True),
        )

    def contracts(self) -> None:
        for contract in self.program.contracts:
            self.prepare(contract.expression)
            holds = self._lowered_contracts.holds(contract.expression, f"contract {contract.name}")
            self._contracts.append(
                ContractCode(
                    name=contract.name,
                    holds=holds,
                    unsimplified=holds,
                    in_time=in_time(self.program.robot, contract),
                )
            )

    # --- variants of guards ----------------------------------------------------------------------

    def variants(self, clients: ClientList, traversal: ClientList) -> None:
        """Lower guards that exclude lost clients, and whatever depends on guards before simplification.

        This comes last, so that the rest of the code is the same with and without variants.
        """
        guards = {(a.actuator, c.module): c for a in clients.actuators for c in a.clients}
        loss_aware = GuardLowering(self.builder, clients, self.active_unless_lost, "heard guard")
        for i, actuator_code in enumerate(self._actuator_codes):
            if actuator_code.actuator.on_loss == "degrade":
                self._actuator_codes[i] = replace(
                    actuator_code,
                    clients=tuple(
                        self._with_loss_aware_guards(
                            c, guards[actuator_code.actuator.name, c.module], loss_aware
                        )
                        for c in actuator_code.clients
                    ),
                )
        if traversal is clients:
            return
        traversed_guards = {(a.actuator, c.module): c.guard for a in traversal.actuators for c in a.clients}
        self.guards = unsimplified = GuardLowering(
            self.builder, traversal, self.module_active, "traversed guard"
        )
        for i, actuator_code in enumerate(self._actuator_codes):
            self._actuator_codes[i] = replace(
                actuator_code,
                clients=tuple(
                    replace(
                        c,
                        unsimplified=unsimplified.guard(
                            traversed_guards[actuator_code.actuator.name, c.module]
                        ),
                    )
                    for c in actuator_code.clients
                ),
            )
        for i, (contract, code) in enumerate(zip(self.program.contracts, self._contracts, strict=True)):
            if self.observes(contract.expression):
                label = f"traversed contract {code.name}"
                holds = self._lowered_contracts.holds(contract.expression, label)
                self._contracts[i] = replace(code, unsimplified=holds)

    def _with_loss_aware_guards(self, code: ClientCode, client: Client, guards: GuardLowering) -> ClientCode:
        """Return the client with guards in which lost clients are not active.

        A lost failsafe one counts as active to others; it does not act itself.
        """
        here = self.builder.literal(True)
        if self.modules[client.module].failsafe:
            here = self.builder.negation(self.builder.add(Lost(client.module), Kind.BOOL))
        return replace(
            code,
            loss_aware_guard=self.builder.both(guards.guard(client.guard), here),
            loss_aware_exclusive=self.builder.both(guards.guard(client.exclusive), here),
        )
