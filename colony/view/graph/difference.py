"""What a change does to a network: modules and wires added and removed, modules moved in priority."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher

from colony.compile.network import ModuleLeaf, Network, Suppressor
from colony.compile.passes.elaborate import elaborate
from colony.compile.pipeline import compile_program
from colony.ir.program import Program
from colony.text.wording import duration_text


@dataclass(frozen=True, slots=True, kw_only=True)
class Marks:
    """Marks in a picture of the new network: `added` or `moved` by the index of a node, and lost modules."""

    of_nodes: Mapping[int, str] = field(default_factory=dict)
    removed: tuple[str, ...] = ()


def difference_lines(old: Program, new: Program) -> list[str]:
    """Return the change as text; no lines if modules, priorities and wires are the same."""
    networks = elaborate(old), elaborate(new)
    lines = [*_module_lines(*networks)]
    before, after = _by_priority(old), _by_priority(new)
    for actuator in dict.fromkeys((*before, *after)):
        found = list(_priority_lines(before.get(actuator, ()), after.get(actuator, ())))
        lines += [f"{actuator}, by priority:", *found] if found else []
    wires = list(_wire_lines(*map(_wirings, networks)))
    return [*lines, *(["wires:", *wires] if wires else [])]


def marks_of(old: Program, new: Program) -> Marks:
    """Return the change as marks of a picture of the new network.

    A node counts as added if the old network has none of its kind with its dominant wire and time constant.
    """
    before, network = elaborate(old), elaborate(new)
    old_modules, new_modules = _modules(before), _modules(network)
    priorities, moved = _by_priority(old), set[str]()
    for actuator, modules in _by_priority(new).items():
        moved |= _moved(priorities.get(actuator, ()), modules)
    known = set(_node_keys(before))
    marks = {}
    for index, (node, key) in enumerate(zip(network.nodes, _node_keys(network), strict=True)):
        if key not in known:
            marks[index] = "added"
        elif isinstance(node, ModuleLeaf) and node.module in moved:
            marks[index] = "moved"
    return Marks(of_nodes=marks, removed=tuple(name for name in old_modules if name not in new_modules))


# --- modules and priorities ---------------------------------------------------------------------------


def _modules(network: Network) -> dict[str, ModuleLeaf]:
    return {node.module: node for node in network.nodes if isinstance(node, ModuleLeaf)}


def _module_lines(old: Network, new: Network) -> Iterator[str]:
    before, after = _modules(old), _modules(new)
    changes = [f"  - {name}" for name in before if name not in after]
    changes += [
        f"  + {name}{' (failsafe)' if leaf.failsafe else ''}"
        for name, leaf in after.items()
        if name not in before
    ]
    changes += [
        f"    {name}: {'now' if leaf.failsafe else 'no longer'} failsafe"
        for name, leaf in after.items()
        if name in before and leaf.failsafe != before[name].failsafe
    ]
    if changes:
        yield "modules:"
        yield from changes


def _by_priority(program: Program) -> dict[str, tuple[str, ...]]:
    """Return the modules that command each actuator, the highest priority first."""
    clients = compile_program(program).clients
    return {a.actuator: tuple(client.module for client in a.clients) for a in clients.actuators}


def _moved(old: Sequence[str], new: Sequence[str]) -> set[str]:
    """Return the modules of both that are not in the longest order that both have in common."""
    before, after = [m for m in old if m in set(new)], [m for m in new if m in set(old)]
    blocks = SequenceMatcher(None, before, after, autojunk=False).get_matching_blocks()
    return set(after) - {name for block in blocks for name in after[block.b : block.b + block.size]}


def _priority_lines(old: Sequence[str], new: Sequence[str]) -> Iterator[str]:
    """Yield what changed, from the highest priority of the new network; then the modules that are lost."""
    moved = _moved(old, new)
    for index, name in enumerate(new):
        above = f"below {new[index - 1]}" if index else "highest"
        below = f", above {new[index + 1]}" if index + 1 < len(new) else ""
        if name not in old:
            yield f"  + {name}: {above}{below}"
        elif name in moved:
            place = old.index(name)
            was = f"below {old[place - 1]}" if place else "highest"
            yield f"    {name}: {above}{below} (was {was})"
    yield from (f"  - {name}" for name in old if name not in new)


# --- wires --------------------------------------------------------------------------------------------


def _wirings(network: Network) -> dict[str, str]:
    """Return the wiring of each named wire and actuator, as programs write it."""
    names = {index: name for name, index in reversed(network.wires)}
    return {name: _wiring(network, index, names, name) for name, index in (*network.wires, *network.outputs)}


def _wiring(network: Network, root: int, names: Mapping[int, str], name: str = "") -> str:
    """Return the wiring of a node, in which wires with names are not followed, but for that of `name`."""
    parts: list[str] = []
    pending: list[int | str] = [root]
    while pending:
        index = pending.pop()
        if isinstance(index, str):
            parts.append(index)
            continue
        node = network.nodes[index]
        own = names.get(index, "")
        if isinstance(node, ModuleLeaf):
            parts.append(node.module)
        elif own and not (index == root and own == name):
            parts.append(own)
        else:
            relation = "suppresses" if isinstance(node, Suppressor) else "inhibits"
            window = f"[{duration_text(node.window_ns)}]" if node.window_ns else ""
            dominant = network.nodes[node.dominant]
            is_simple = isinstance(dominant, ModuleLeaf) or node.dominant in names
            opening, closing = ("", "") if is_simple else ("(", ")")
            pending += [node.inferior, f"{closing} {relation}{window} ", node.dominant, opening]
    return "".join(parts)


def _wire_lines(old: Mapping[str, str], new: Mapping[str, str]) -> Iterator[str]:
    for name in dict.fromkeys((*old, *new)):
        if old.get(name) != new.get(name):
            yield from (
                f"  {sign} {name} = {wires[name]}"
                for sign, wires in (("-", old), ("+", new))
                if name in wires
            )


def _node_keys(network: Network) -> list[tuple[str, int, str]]:
    """Return what each node is known by: its kind, its time constant, and its dominant wire or its module."""
    names = {index: name for name, index in reversed(network.wires)}
    return [
        ("module", 0, node.module)
        if isinstance(node, ModuleLeaf)
        else (type(node).__name__, node.window_ns, _wiring(network, node.dominant, names))
        for node in network.nodes
    ]
