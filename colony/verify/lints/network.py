"""The network with a name for every node, so that claims can refer to nodes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from colony.ir import expression as ir
from colony.ir.program import Program, Use, Wire, Wiring
from colony.ir.wiring import WiringNode, wiring_graph
from colony.text.source import Span
from colony.text.wording import duration_text
from colony.verify.claims import FALSE, active, all_of, any_of, negation


@dataclass(frozen=True, slots=False, kw_only=True)
class NamedNetwork:
    """The network of a program in which every node is a wire of its own.

    Attributes:
        wires: one wire for each node, then the wires of the program.
        nodes: the suppressors and inhibitors with a path to an actuator, by name, each after its inputs.
        roots: the module or node that drives each wired actuator.
    """

    wires: tuple[Wire, ...]
    nodes: dict[str, WiringNode]
    roots: Mapping[str, str]
    _modules_under: dict[str, tuple[str, ...]] = field(default_factory=dict, init=False, repr=False)
    _dominators: dict[str, tuple[str, ...]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def _numbers(self) -> dict[str, int]:
        """The number of each module."""
        numbers: dict[str, int] = {}
        for node in self.nodes.values():
            for name in (node.dominant, node.inferior):
                if name not in self.nodes:
                    numbers.setdefault(name, len(numbers))
        for name in self.roots.values():
            if name not in self.nodes:
                numbers.setdefault(name, len(numbers))
        return numbers

    @cached_property
    def _sets_under(self) -> dict[str, int]:
        """The modules below each node as a set of bits, by number, which takes little space."""
        sets = {module: 1 << number for module, number in self._numbers.items()}
        for node in self.nodes.values():
            sets[node.name] = sets[node.dominant] | sets[node.inferior]
        return sets

    @cached_property
    def _sets_above(self) -> dict[str, int]:
        """The modules that dominate each module or node somewhere, as a set of bits."""
        sets: dict[str, int] = {}
        for node in reversed(self.nodes.values()):
            above = sets.get(node.name, 0)
            sets[node.dominant] = sets.get(node.dominant, 0) | above
            sets[node.inferior] = sets.get(node.inferior, 0) | above | self._sets_under[node.dominant]
        return sets

    def set_of(self, modules: Iterable[str]) -> int:
        """Return wired modules as a set of bits."""
        return sum(1 << self._numbers[m] for m in dict.fromkeys(modules) if m in self._numbers)

    def dominates(self, modules: int, module: str) -> bool:
        """Return True if one of a set of other modules (`set_of`) dominates a module somewhere."""
        others = modules & ~(1 << self._numbers[module])
        return bool(self._sets_above.get(module, 0) & others)

    def is_under(self, module: str, ref: str) -> bool:
        """Return True if a module is below a node, or is `ref` itself."""
        number = self._numbers.get(module)
        return number is not None and bool(self._sets_under[ref] >> number & 1)

    def modules_under(self, ref: str) -> tuple[str, ...]:
        """Return the modules below a node, dominant ones first, or the module itself."""
        if ref not in self._modules_under:
            self._modules_under[ref] = self._find_modules_under(ref)
        return self._modules_under[ref]

    def _find_modules_under(self, ref: str) -> tuple[str, ...]:
        modules: dict[str, None] = {}
        pending, seen = [ref], set[str]()
        while pending:
            name = pending.pop()
            if name in seen:
                continue
            seen.add(name)
            if name in self.nodes:
                pending += [self.nodes[name].inferior, self.nodes[name].dominant]
            else:
                modules[name] = None
        return tuple(modules)

    def output_condition(self, module: str, ref: str, depth: int = 0) -> ir.Expression | None:
        """Return the condition that `module`'s output is on `ref`, None if the network is too deep."""
        if ref not in self.nodes:
            return active(module) if ref == module else FALSE
        if not self.is_under(module, ref):
            return FALSE
        if depth >= _MAX_DEPTH:
            return None
        node = self.nodes[ref]
        inferior_condition = self.output_condition(module, node.inferior, depth + 1)
        if inferior_condition is None:
            return None
        if node.relation == "inhibits":
            return FALSE if inferior_condition is FALSE else all_of((active(ref), inferior_condition))
        dominant_condition = self.output_condition(module, node.dominant, depth + 1)
        if dominant_condition is None:
            return None
        passed = (
            []
            if inferior_condition is FALSE
            else [all_of((active(ref), negation(active(node.dominant)), inferior_condition))]
        )
        return any_of((*([] if dominant_condition is FALSE else [dominant_condition]), *passed))

    def nodes_above(self, module: str) -> Iterator[WiringNode]:
        """Yield the nodes on whose inferior side a module is."""
        return (node for node in self.nodes.values() if self.is_under(module, node.inferior))

    def dominators(self, module: str) -> tuple[str, ...]:
        """Return the other modules that dominate a module, in the order of the nodes at which they do."""
        if module not in self._dominators:
            found: dict[str, None] = {}
            for node in self.nodes_above(module):
                found |= dict.fromkeys(self.modules_under(node.dominant))
            found.pop(module, None)
            self._dominators[module] = tuple(found)
        return self._dominators[module]


_MAX_DEPTH = 24


def network(program: Program) -> NamedNetwork:
    """Return the network of `program`, with a wire for every node."""
    graph = wiring_graph(program)
    reached = set(graph.roots.values())
    for node in reversed(graph.nodes):
        if node.name in reached:
            reached |= {node.dominant, node.inferior}
    targets = {
        w.name: graph.wires[w.name] if w.actuator is None else graph.roots[w.actuator] for w in program.wires
    }
    node_wires = (node.wire(node.name, node.dominant, node.inferior) for node in graph.nodes)
    program_wires = (replace(wire, wiring=Use(name=targets[wire.name])) for wire in program.wires)
    nodes = {node.name: node for node in graph.nodes if node.name in reached}
    return NamedNetwork(wires=(*node_wires, *program_wires), nodes=nodes, roots=graph.roots)


def span_of(node: WiringNode) -> Span:
    """Return the span of a node: from its dominant operand to the end of its chain."""
    first, last = node.chain.operands[node.index].span, node.chain.operands[-1].span
    return Span(first.source, first.start, max(last.end, first.end))


def text_of(node: WiringNode) -> str:
    """Return the source text of a node, without the contents of parentheses."""
    dominant, inferior, *further = node.chain.operands[node.index :]
    window = f"[{duration_text(node.window_ns)}]" if node.window_ns else ""
    text = f"{_short(dominant)} {node.relation}{window} {_short(inferior)}"
    return f"{text} ..." if further else text


def _short(wiring: Wiring) -> str:
    return wiring.name if isinstance(wiring, Use) else "(...)"
