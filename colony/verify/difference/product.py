"""The product of two programs: it reads one set of sensors, and has the actuators and networks of both.

Values, memory, modules and nodes of the network with equal contents are equal in every run, so the product
has them once. The rest is left to a proof.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import assert_never

from colony.ir import expression as ir
from colony.ir.program import (
    AnyModule,
    Derived,
    Let,
    Limit,
    Machine,
    Module,
    Program,
    PythonModule,
    Robot,
    State,
    TransferFunction,
    Use,
    Wire,
)
from colony.ir.walk import WiringNode, all_subexpressions, wiring_graph
from colony.verify.difference.content import Contents, contents

# --- rewriting ----------------------------------------------------------------------------------------
#
# Renaming of what an expression reads, and of its memory cells.

Rename = Callable[[str], str]


def rewrite_expression(e: ir.Expression, rename: Rename, shift: int) -> ir.Expression:
    """Return `e` with derived values, states and modules' lets renamed, and cells shifted by `shift`.

    Sensors keep their names. `e` is not the expression of a contract.
    """
    rewrite = partial(rewrite_expression, rename=rename, shift=shift)
    match e:
        case ir.DerivedValue(name=name) | ir.LocalValue(name=name) | ir.StateValue(name=name):
            return replace(e, name=rename(name))
        case ir.Fresh(name=name, derived=derived):
            return replace(e, name=rename(name)) if derived else e
        case ir.MemoryCall():
            return ir.rebuilt(replace(e, cell=e.cell + shift), rewrite)
        case _:
            return ir.rebuilt(e, rewrite)


# --- product ------------------------------------------------------------------------------------------

B_SUFFIX = " of B"
"""Suffix of the names that only B has. It begins with a blank, which no name of the language contains."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Product:
    """Two programs in one.

    `program` has both networks. `modules` maps each module of B to its name there; `roots` maps each
    actuator, by its name there, to the wire that drives it; `limits` gives the contents of the limits of each
    field.
    """

    program: Program
    modules: dict[str, str]
    roots: dict[str, str]
    limits: dict[tuple[str, int], tuple[int, ...]]


def product(a: Program, b: Program) -> Product:
    """Return both programs as one, without their contracts and tests."""
    return _Merger(a, b).run()


class _Merger:
    """A product in progress. Mutable: its parts so far."""

    def __init__(self, a: Program, b: Program) -> None:
        self._a, self._b = a, b
        self._contents = contents(a, b)
        self._derived: list[Derived] = []
        self._modules: list[AnyModule] = []
        self._wires: list[Wire] = []
        self._limits: list[Limit] = []
        self._bounds: dict[tuple[str, int], tuple[int, ...]] = {}
        self._names: dict[int, list[str]] = {}
        self._nodes: dict[tuple[str, str, str, int], str] = {}
        self._roots: dict[str, str] = {}

    def run(self) -> Product:
        of_a, of_b = self._contents
        self._declare(self._a, of_a, "", 0)
        shift = 1 + max(
            (x.cell for x in all_subexpressions(self._a) if isinstance(x, ir.MemoryCall)), default=0
        )
        renamed = self._declare(self._b, of_b, B_SUFFIX, shift)
        program = Program(
            robot=self._robot(),
            derived=tuple(self._derived),
            modules=tuple(self._modules),
            wires=tuple(self._wires),
            limits=tuple(self._limits),
        )
        modules = {m.name: renamed[m.name] for m in self._b.modules}
        return Product(program=program, modules=modules, roots=self._roots, limits=self._bounds)

    def _robot(self) -> Robot:
        sensors = {s.name: s for s in (*self._a.robot.sensors, *self._b.robot.sensors)}
        actuators = (replace(x, name=x.name + B_SUFFIX) for x in self._b.robot.actuators)
        jitters_ns = {self._a.robot.jitter_ns, self._b.robot.jitter_ns}
        return replace(
            self._a.robot,
            jitter_ns=jitters_ns.pop() if len(jitters_ns) == 1 else None,
            sensors=tuple(sensors.values()),
            actuators=(*self._a.robot.actuators, *actuators),
        )

    def _declare(
        self, program: Program, program_contents: Contents, suffix: str, shift: int
    ) -> dict[str, str]:
        """Add the new parts of one program; return the names of all its parts in the product."""
        existing = {content: tuple(names) for content, names in self._names.items()}
        renamed: dict[str, str] = {}

        def rename(name: str) -> str:
            return renamed.get(name, name + suffix)

        for derived in program.derived:
            content = program_contents.derived(derived)
            renamed[derived.name] = _product_name(derived.name, existing.get(content, ()), suffix)
            self._names.setdefault(content, []).append(derived.name)
        for derived in program.derived:
            if program_contents.derived(derived) not in existing:
                self._derived.append(_derived(derived, rename, shift))
        for module in program.modules:
            content = program_contents.module(module)
            renamed[module.name] = _product_name(module.name, existing.get(content, ()), suffix)
            self._names.setdefault(content, []).append(module.name)
            if content not in existing:
                self._modules.append(_module(module, rename, suffix, shift))
        for limit in program.limits:
            actuator = limit.actuator + suffix
            key = (actuator, limit.field_index)
            self._bounds[key] = (*self._bounds.get(key, ()), program_contents.limit(limit))
            self._limits.append(_limit(limit, actuator, rename, shift))
        self._network(program, renamed, suffix)
        return renamed

    # --- the network -----------------------------------------------------------------------------

    def _network(self, program: Program, renamed: dict[str, str], suffix: str) -> None:
        """Add every node as a wire of its own; equal nodes are one."""
        wired, outputs = wiring_graph(program), dict(renamed)
        for node in wired.nodes:
            outputs[node.name] = self._node(node, outputs[node.dominant], outputs[node.inferior])
        for actuator, root in wired.roots.items():
            name = actuator + suffix
            self._roots[name] = outputs[root]
            self._wires.append(Wire(name=name, wiring=Use(name=outputs[root]), actuator=name))

    def _node(self, node: WiringNode, dominant: str, inferior: str) -> str:
        """Return the wire of a node, adding it at its first occurrence."""
        key = (node.relation, dominant, inferior, node.window_ns)
        if key not in self._nodes:
            name = self._nodes[key] = f"node {len(self._nodes)}"
            self._wires.append(node.wire(name, dominant, inferior))
        return self._nodes[key]


def _product_name(name: str, equal_names: Sequence[str], suffix: str) -> str:
    """Return an existing name with the same content, preferably `name`; else `name` with the suffix."""
    if not equal_names:
        return name + suffix
    return name if name in equal_names else equal_names[0]


# --- renamed declarations --------------------------------------------------------------------------


def _derived(derived: Derived, rename: Rename, shift: int) -> Derived:
    name = rename(derived.name)
    match derived:
        case Let():
            return replace(
                derived, name=name, expression=rewrite_expression(derived.expression, rename, shift)
            )
        case State():
            return replace(derived, name=name, next=_optional(derived.next, rename, shift))
        case Machine():
            transitions = tuple(
                replace(t, condition=rewrite_expression(t.condition, rename, shift))
                for t in derived.transitions
            )
            return replace(derived, name=name, transitions=transitions)
        case _:
            assert_never(derived)


def _module(module: AnyModule, rename: Rename, suffix: str, shift: int) -> AnyModule:
    name = rename(module.name)
    match module:
        case Module():
            return replace(
                module,
                name=name,
                lets=tuple(
                    replace(
                        x, name=rename(x.name), expression=rewrite_expression(x.expression, rename, shift)
                    )
                    for x in module.lets
                ),
                states=tuple(
                    replace(x, name=rename(x.name), next=_optional(x.next, rename, shift))
                    for x in module.states
                ),
                when=rewrite_expression(module.when, rename, shift),
                command=_command(module.command, rename, suffix, shift),
            )
        case PythonModule(actuator=actuator):
            reads = tuple(
                replace(r, expression=rewrite_expression(r.expression, rename, shift)) for r in module.reads
            )
            return replace(
                module, name=name, reads=reads, actuator=None if actuator is None else actuator + suffix
            )
        case _:
            assert_never(module)


def _command(
    command: TransferFunction | None, rename: Rename, suffix: str, shift: int
) -> TransferFunction | None:
    if command is None:
        return None
    fields = tuple(rewrite_expression(e, rename, shift) for e in command.fields)
    return TransferFunction(actuator=command.actuator + suffix, fields=fields)


def _limit(limit: Limit, actuator: str, rename: Rename, shift: int) -> Limit:
    bound, condition = (
        rewrite_expression(limit.bound, rename, shift),
        _optional(limit.condition, rename, shift),
    )
    return replace(limit, actuator=actuator, bound=bound, condition=condition)


def _optional(e: ir.Expression | None, rename: Rename, shift: int) -> ir.Expression | None:
    return None if e is None else rewrite_expression(e, rename, shift)
