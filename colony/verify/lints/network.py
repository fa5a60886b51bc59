"""The network with a name for every node, so that claims can speak of all of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from colony.ir import expression as ir
from colony.ir.program import Chain, Program, Use, Wire, Wiring
from colony.text.source import Span
from colony.verify.lints.claims import FALSE, active, all_of, any_of, negation


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """A suppressor or inhibitor; `dominant` and `inferior` are modules or nodes. `span` is that of the
    wiring from its dominant operand to its end.
    """

    name: str
    relation: str
    dominant: str
    inferior: str
    window_ns: int
    span: Span
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Network:
    """`wires` are those of the program with a wire for each node besides; `nodes` stand after what they use.

    `roots` gives what drives each wired actuator. Only what reaches an actuator is in `nodes`.
    """

    wires: tuple[Wire, ...]
    nodes: dict[str, Node]
    roots: dict[str, str]

    def under(self, ref: str) -> tuple[str, ...]:
        """The modules below a node, or the module itself, the dominant ones first."""
        found: dict[str, None] = {}
        todo, seen = [ref], set[str]()
        while todo:
            name = todo.pop()
            if name in seen:
                continue
            seen.add(name)
            if name in self.nodes:
                todo += [self.nodes[name].inferior, self.nodes[name].dominant]
            else:
                found[name] = None
        return tuple(found)

    def emerges(self, module: str, ref: str, depth: int = 0) -> ir.Expression | None:
        """That `module` is the one whose output is on `ref`; None where that is too deep to say."""
        if ref not in self.nodes:
            return active(module) if ref == module else FALSE
        if depth >= _DEEPEST:
            return None
        node = self.nodes[ref]
        below = self.emerges(module, node.inferior, depth + 1)
        if below is None:
            return None
        if node.relation == "inhibits":
            return FALSE if below is FALSE else all_of((active(ref), below))
        above = self.emerges(module, node.dominant, depth + 1)
        if above is None:
            return None
        passed = [] if below is FALSE else [all_of((active(ref), negation(active(node.dominant)), below))]
        return any_of((*([] if above is FALSE else [above]), *passed))

    def above(self, module: str) -> Iterator[Node]:
        """The nodes on whose inferior side a module is."""
        for node in self.nodes.values():
            if module in self.under(node.inferior):
                yield node


_DEEPEST = 24


def network(program: Program) -> Network:
    """The network of `program`, every node with a name of its own."""
    namer = _Namer()
    for wire in program.wires:
        namer.wire(wire)
    reached = set[str]()
    todo = list(namer.roots.values())
    while todo:
        name = todo.pop()
        if name not in reached:
            reached.add(name)
            node = namer.nodes.get(name)
            todo += [node.dominant, node.inferior] if node else []
    nodes = {name: node for name, node in namer.nodes.items() if name in reached}
    return Network(wires=tuple(namer.wires), nodes=nodes, roots=namer.roots)


class _Namer:
    """Mutable: the wires and nodes so far, and what each wire of the program stands for."""

    def __init__(self) -> None:
        self.wires: list[Wire] = []
        self.nodes: dict[str, Node] = {}
        self.roots: dict[str, str] = {}
        self._stands_for: dict[str, str] = {}

    def wire(self, wire: Wire) -> None:
        root = self._wiring(wire.wiring)
        self.wires.append(replace(wire, wiring=Use(name=root)))
        if wire.actuator is None:
            self._stands_for[wire.name] = root
        else:
            self.roots[wire.actuator] = root

    def _wiring(self, wiring: Wiring) -> str:
        if isinstance(wiring, Use):
            return self._stands_for.get(wiring.name, wiring.name)
        last = len(wiring.operands) - 1
        inferior = self._wiring(wiring.operands[last])
        for i in reversed(range(last)):
            inferior = self._node(wiring, i, self._wiring(wiring.operands[i]), inferior)
        return inferior

    def _node(self, chain: Chain, i: int, dominant: str, inferior: str) -> str:
        name, window = f"node {len(self.nodes)}", chain.windows_ns[i]
        first, last = chain.operands[i].span, chain.operands[-1].span
        span = Span(first.source, first.start, max(last.end, first.end))
        text = (
            f"{_short(chain.operands[i])} {chain.relation}{_constant(window)} {_short(chain.operands[i + 1])}"
        )
        text += " ..." if i + 2 < len(chain.operands) else ""
        self.nodes[name] = Node(
            name=name,
            relation=chain.relation,
            dominant=dominant,
            inferior=inferior,
            window_ns=window,
            span=span,
            text=text,
        )
        operands = (Use(name=dominant), Use(name=inferior))
        wiring = replace(chain, operands=operands, windows_ns=(window,))
        self.wires.append(Wire(name=name, span=chain.span, wiring=wiring))
        return name


def _constant(window_ns: int) -> str:
    return f"[{window_ns / 1e9:g} s]" if window_ns else ""


def _short(wiring: Wiring) -> str:
    return wiring.name if isinstance(wiring, Use) else "(...)"
