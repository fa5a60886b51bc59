"""The definitions of `active` and `out`, of guards and of clients, executed as they read."""

from __future__ import annotations

from collections.abc import Sequence
from typing import assert_never

from hypothesis import strategies as st

from colony.compile.guards import Always, And, ClientList, Guard, ModuleActive, Never, Not, Or, Recently
from colony.compile.network import Inhibitor, ModuleLeaf, Network, NetworkNode, Suppressor

MS = 1_000_000
History = list[tuple[int, frozenset[str]]]


class NetworkRun:
    """A network frame by frame: `step` gives each node's output (the module whose command it is, or None)."""

    def __init__(self, network: Network) -> None:
        self.nodes = network.nodes
        self.last: dict[int, int] = {}  # when the dominant of a node was last active

    def step(self, t_ns: int, active: frozenset[str]) -> list[str | None]:
        out: list[str | None] = []
        for at, node in enumerate(self.nodes):
            match node:
                case ModuleLeaf(module=module):
                    out.append(module if module in active else None)
                case Suppressor(dominant=dominant, inferior=inferior):
                    dominates = self.dominates(at, node, t_ns, out[dominant] is not None)
                    out.append(out[dominant] if dominates else out[inferior])
                case Inhibitor(dominant=dominant, inferior=inferior):
                    dominates = self.dominates(at, node, t_ns, out[dominant] is not None)
                    out.append(None if dominates else out[inferior])
                case _:
                    assert_never(node)
        return out

    def dominates(self, at: int, node: Suppressor | Inhibitor, t_ns: int, active: bool) -> bool:
        if active:
            self.last[at] = t_ns
        return active or (at in self.last and t_ns < self.last[at] + node.window_ns)


class GuardRun:
    """A table of guards frame by frame: `step` gives the value of each."""

    def __init__(self, guards: Sequence[Guard]) -> None:
        self.guards = guards
        self.last: dict[int, int] = {}

    def step(self, t_ns: int, active: frozenset[str]) -> list[bool]:
        value: list[bool] = []
        for at, guard in enumerate(self.guards):
            match guard:
                case Always():
                    value.append(True)
                case Never():
                    value.append(False)
                case ModuleActive(module=module):
                    value.append(module in active)
                case Not(operand=operand):
                    value.append(not value[operand])
                case And(operands=operands):
                    value.append(all(value[operand] for operand in operands))
                case Or(operands=operands):
                    value.append(any(value[operand] for operand in operands))
                case Recently(operand=operand, window_ns=window_ns):
                    if value[operand]:
                        self.last[at] = t_ns
                    recent = at in self.last and t_ns < self.last[at] + window_ns
                    value.append(value[operand] or recent)
                case _:
                    assert_never(guard)
        return value


def assert_same(network: Network, clients: ClientList, history: History) -> None:
    """In every frame of a history, the clients do what the network does, by both readings of their guards."""
    network_run, guard_run = NetworkRun(network), GuardRun(clients.guards)
    t_ns = 0
    for dt_ns, active in history:
        t_ns += dt_ns
        out, holds = network_run.step(t_ns, active), guard_run.step(t_ns, active)
        assert [a.actuator for a in clients.actuators] == [name for name, _ in network.outputs]
        for (_, node), one in zip(network.outputs, clients.actuators, strict=True):
            first = next((c.module for c in one.clients if holds[c.guard]), None)
            exclusive = [c.module for c in one.clients if holds[c.exclusive]]
            assert first == out[node]
            assert exclusive == [first] * (first is not None)
        assert [(name, holds[ref]) for name, ref in clients.observed] == [
            (name, out[node] is not None) for name, node in network.observed
        ]


WINDOWS_NS = (0, 0, 1 * MS, 50 * MS, 120 * MS)


@st.composite
def networks(draw: st.DrawFn, modules: int = 5, joints: int = 10, outputs: int = 2) -> Network:
    """Small networks of any form: sharing, inhibitors below inhibitors, time constants, several outputs."""
    nodes: list[NetworkNode] = [ModuleLeaf(module=f"m{i}") for i in range(draw(st.integers(1, modules)))]
    for _ in range(draw(st.integers(0, joints))):
        joint = draw(st.sampled_from([Suppressor, Suppressor, Inhibitor]))
        inputs = st.integers(0, len(nodes) - 1)
        nodes.append(
            joint(dominant=draw(inputs), inferior=draw(inputs), window_ns=draw(st.sampled_from(WINDOWS_NS)))
        )
    some = st.integers(0, len(nodes) - 1)
    roots = [len(nodes) - 1, *draw(st.lists(some, max_size=outputs - 1))]
    return Network(
        nodes=tuple(nodes),
        outputs=tuple((f"a{i}", root) for i, root in enumerate(roots)),
        observed=tuple((f"n{node}", node) for node in draw(st.sets(some, max_size=2))),
    )


def histories(modules: int = 5, frames: int = 8) -> st.SearchStrategy[History]:
    """Which modules are active, frame by frame, and the time from frame to frame."""
    active = st.frozensets(st.sampled_from([f"m{i}" for i in range(modules)]))
    return st.lists(st.tuples(st.sampled_from([1 * MS, 50 * MS, 70 * MS]), active), max_size=frames)


def all_valuations(network: Network) -> History:
    """Every set of active modules once, each a frame, far enough apart that no time constant reaches over."""
    modules = [node.module for node in network.nodes if isinstance(node, ModuleLeaf)]
    return [
        (10_000 * MS, frozenset(m for i, m in enumerate(modules) if bits >> i & 1))
        for bits in range(1 << len(modules))
    ]
