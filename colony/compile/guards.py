"""Guards: one table of hash-consed Boolean nodes over the activity of modules.

A guard is a reference (an index) into the table, so that parts shared by clients are stored once
and the output stays near-linear in the network, in memory and in JSON. Operands always come before the node
that uses them: a table is evaluated in one pass, without recursion.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Always:
    """The guard that is always true."""


@dataclass(frozen=True, slots=True)
class Never:
    """The guard that is never true."""


@dataclass(frozen=True, slots=True)
class ModuleActive:
    """The module puts a command on its output: its predicate holds, and it is not silent."""

    module: str


@dataclass(frozen=True, slots=True)
class Not:
    """The negation of a guard."""

    operand: int


@dataclass(frozen=True, slots=True)
class And:
    """The conjunction of two or more operands."""

    operands: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Or:
    """The disjunction of two or more operands."""

    operands: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Recently:
    """True from a frame in which the operand is true until `window_ns` after the last one, exclusive.

    It has memory, which is updated in every frame.
    """

    operand: int
    window_ns: int


Guard = Always | Never | ModuleActive | Not | And | Or | Recently


def operands(guard: Guard) -> tuple[int, ...]:
    """Return the operands of a guard, in order."""
    match guard:
        case And(operands=parts) | Or(operands=parts):
            return parts
        case Not(operand=operand) | Recently(operand=operand):
            return (operand,)
        case Always() | Never() | ModuleActive():
            return ()


@dataclass(slots=True)
class GuardTable:
    """A mutable table in which equal nodes have one reference; `freeze` returns its nodes."""

    nodes: list[Guard]
    _index: dict[Guard, int]
    _always: int

    def __init__(self, nodes: tuple[Guard, ...] = ()) -> None:
        self.nodes = list(nodes)
        self._index = {node: i for i, node in enumerate(nodes)}
        self._always = self._index.get(Always(), -1)

    def add(self, node: Guard) -> int:
        """Return the reference of `node`, added if it is new; its operands must be in the table."""
        reference = self._index.get(node)
        if reference is None:
            reference = self._index[node] = len(self.nodes)
            self.nodes.append(node)
            if isinstance(node, Always):
                self._always = reference
        return reference

    def negation(self, operand: int) -> int:
        """Return `not operand`."""
        return self.add(Not(operand))

    def conjunction(self, parts: tuple[int, ...]) -> int:
        """Return the conjunction of `parts`; parts that are `Always` are dropped."""
        always = self._always
        kept = tuple([part for part in parts if part != always])
        if len(kept) > 1:
            return self.add(And(kept))
        return kept[0] if kept else self.add(Always())

    def disjunction(self, parts: tuple[int, ...]) -> int:
        """Return the disjunction of `parts`."""
        if len(parts) > 1:
            return self.add(Or(parts))
        return parts[0] if parts else self.add(Never())

    def recently(self, operand: int, window_ns: int) -> int:
        """Return the guard "`operand` held within the window"; without a window, `operand` itself."""
        return self.add(Recently(operand, window_ns)) if window_ns > 0 else operand

    def freeze(self) -> tuple[Guard, ...]:
        """Return the nodes of the table so far."""
        return tuple(self.nodes)


# --- clients ------------------------------------------------------------------------------------------
#
# The compiled form: prioritized clients, one per module and actuator (thesis section 4.8.2).
#
# An actuator's winner is the first client whose guard holds and, equivalently, the only one whose exclusive
# guard holds: in no frame do two exclusive guards of one actuator hold.


@dataclass(frozen=True, slots=True, kw_only=True)
class Client:
    """A module as a client of its actuator's server.

    `guard` and `exclusive` are indices into the guards of the client list; both include the module's own
    activity. `guard` is the thesis's, to be combined with priorities. `exclusive` holds only in frames in
    which the network lets the module through. With several paths to the actuator, both are the exclusive
    guard.
    """

    module: str
    priority: int
    guard: int
    exclusive: int
    has_several_paths: bool = field(default=False, compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorClients:
    """The clients of one actuator, highest priority first; priorities are n, ..., 2, 1."""

    actuator: str
    clients: tuple[Client, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ClientList:
    """All clients of a program over one table of guards.

    Attributes:
        guards: the table of guards.
        actuators: the clients of each wired actuator.
        observed: the guard for the activity of each wire or module that contracts and tests read.
        windows: the guard of each time constant, by its name in `ir.memory`; empty after simplification,
            which merges and drops some of them.
    """

    guards: tuple[Guard, ...]
    actuators: tuple[ActuatorClients, ...]
    observed: tuple[tuple[str, int], ...] = ()
    windows: tuple[tuple[str, int], ...] = field(default=(), compare=False)
