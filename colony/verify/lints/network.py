"""The network with a name for every node, so that claims can refer to each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from colony.ir import expression as ir
from colony.ir.program import Program, Use, Wire, Wiring
from colony.ir.wiring import Joint, joints_of
from colony.text.source import Span
from colony.text.wording import duration_text
from colony.verify.claims import FALSE, active, all_of, any_of, negation


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedNetwork:
    """The network of a program in which every joint is a wire of its own.

    Attributes:
        wires: Wires of the program, after one for each joint.
        joints: Joints that reach an actuator, by name, each after its inputs.
        roots: Module or joint that drives each wired actuator.
    """

    wires: tuple[Wire, ...]
    joints: dict[str, Joint]
    roots: Mapping[str, str]

    def under(self, ref: str) -> tuple[str, ...]:
        """Return the modules below a node, or the module itself, the dominant ones first."""
        found: dict[str, None] = {}
        todo, seen = [ref], set[str]()
        while todo:
            name = todo.pop()
            if name in seen:
                continue
            seen.add(name)
            if name in self.joints:
                todo += [self.joints[name].inferior, self.joints[name].dominant]
            else:
                found[name] = None
        return tuple(found)

    def emerges(self, module: str, ref: str, depth: int = 0) -> ir.Expression | None:
        """Return the condition that `module`'s output is on `ref`; None where that is too deep to express."""
        if ref not in self.joints:
            return active(module) if ref == module else FALSE
        if depth >= _MAX_DEPTH:
            return None
        joint = self.joints[ref]
        below = self.emerges(module, joint.inferior, depth + 1)
        if below is None:
            return None
        if joint.relation == "inhibits":
            return FALSE if below is FALSE else all_of((active(ref), below))
        above = self.emerges(module, joint.dominant, depth + 1)
        if above is None:
            return None
        passed = [] if below is FALSE else [all_of((active(ref), negation(active(joint.dominant)), below))]
        return any_of((*([] if above is FALSE else [above]), *passed))

    def above(self, module: str) -> Iterator[Joint]:
        """Yield the joints on whose inferior side a module is."""
        for joint in self.joints.values():
            if module in self.under(joint.inferior):
                yield joint


_MAX_DEPTH = 24


def network(program: Program) -> NamedNetwork:
    """Return the network of `program`, every joint with a wire of its own."""
    wired = joints_of(program)
    reached = set(wired.roots.values())
    for joint in reversed(wired.joints):
        if joint.name in reached:
            reached |= {joint.dominant, joint.inferior}
    ends = {
        w.name: wired.wires[w.name] if w.actuator is None else wired.roots[w.actuator] for w in program.wires
    }
    own = (joint.wire(joint.name, joint.dominant, joint.inferior) for joint in wired.joints)
    named = (replace(wire, wiring=Use(name=ends[wire.name])) for wire in program.wires)
    joints = {joint.name: joint for joint in wired.joints if joint.name in reached}
    return NamedNetwork(wires=(*own, *named), joints=joints, roots=wired.roots)


def span_of(joint: Joint) -> Span:
    """Return the place of a joint: from its dominant operand to the end of its chain."""
    first, last = joint.chain.operands[joint.index].span, joint.chain.operands[-1].span
    return Span(first.source, first.start, max(last.end, first.end))


def text_of(joint: Joint) -> str:
    """Return a joint as it is written, without the contents of parentheses."""
    dominant, inferior, *more = joint.chain.operands[joint.index :]
    window = f"[{duration_text(joint.window_ns)}]" if joint.window_ns else ""
    text = f"{_short(dominant)} {joint.relation}{window} {_short(inferior)}"
    return f"{text} ..." if more else text


def _short(wiring: Wiring) -> str:
    return wiring.name if isinstance(wiring, Use) else "(...)"
