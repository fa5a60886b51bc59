"""The thesis's compilation steps for a program, as text, from its wiring to the guards of its clients.

Large sections are truncated; a last line says how much is left out.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from colony.compile.backends.table import GuardText, definitions, legend, rows, wrapped
from colony.compile.guards import ActuatorClients, Always, ModuleActive
from colony.compile.network import GatedSuppressor, ModuleLeaf, NodeUse, SuppressionNetwork
from colony.compile.pipeline import Compilation
from colony.ir.program import Program, Use, Wiring
from colony.text.wording import duration_text

MAX_LINES = 200
"""Maximum number of wires, modules or nodes that a section shows."""

MAX_DEPTH = 25
"""Maximum depth of a printed tree."""

_WIDTH = 100
_INDENT = "  "


def explain(compilation: Compilation) -> str:
    """Explain step by step how the compiler treats this program, for `colony compile --explain`.

    The text has no line break at its end.
    """
    guards = GuardText(compilation.clients.guards)
    sections = [
        _section("The network as wired", _wires(compilation.program)),
        _section(
            "Without inhibitors: `A inhibits B` is B with `not A` in its guard (Lemma 4.1)",
            _without_inhibitors(compilation, guards),
        ),
    ]
    for (actuator, root), clients in zip(
        compilation.suppression.outputs, compilation.clients.actuators, strict=True
    ):
        sections += [
            _section(
                f"The binary tree of {actuator}: dominant link right, inferior link left (Table 4.2)",
                _tree(compilation.suppression, root, clients),
            ),
            _section(
                f"The forward traversal of {actuator}: left before right, last visited is highest",
                _visits(clients),
            ),
            f"The clients of {actuator}\n{rows(clients, guards, MAX_LINES)}",
        ]
    sections.append(legend(guards, MAX_LINES))
    return "\n\n".join(sections)


def _section(title: str, lines: Iterable[str]) -> str:
    return "\n".join([title, *(_INDENT + line for line in lines)])


# --- wires ---------------------------------------------------------------------------------------


def _wires(program: Program) -> list[str]:
    """Return one line per wire, and several for a long wire."""
    wires = program.wires[:MAX_LINES]
    width = max((len(wire.name) for wire in wires), default=0)
    lines: list[str] = []
    for wire in wires:
        lines += _hanging(f"{wire.name:{width}} = ", wiring_text(wire.wiring))
    left_out = len(program.wires) - len(wires)
    return [*lines, f"({left_out} more wires left out)"] if left_out else lines or ["(nothing is wired)"]


def wiring_text(wiring: Wiring, max_operands: int = MAX_LINES) -> str:
    """Return a wiring as source text, with at most `max_operands` operands per chain.

    The recursion is only as deep as the nesting of parentheses.
    """
    match wiring:
        case Use(name=name):
            return name
        case _:
            shown = wiring.operands[:max_operands]
            parts = [o.name if isinstance(o, Use) else f"({wiring_text(o, max_operands)})" for o in shown]
            windows = [f"[{duration_text(ns)}]" if ns else "" for ns in wiring.windows_ns]
            text = parts[0]
            for window, part in zip(windows, parts[1:], strict=False):
                text += f" {wiring.relation}{window} {part}"
            left_out = len(wiring.operands) - len(shown)
            return f"{text} {wiring.relation} ... ({left_out} more)" if left_out else text


def _hanging(head: str, text: str) -> list[str]:
    """Return `head` and `text` as lines; continuation lines are indented to the start of the text."""
    first, *continuation = wrapped(text, max(_WIDTH - len(head), 40))
    return [head + first, *(" " * len(head) + line for line in continuation)]


# --- inhibition elimination ----------------------------------------------------------------------


def _without_inhibitors(compilation: Compilation, guards: GuardText) -> list[str]:
    """Return each module that can command, with the guard that results from the gates on its path."""
    clients = [client for actuator in compilation.clients.actuators for client in actuator.clients]
    width = max((len(client.module) for client in clients[:MAX_LINES]), default=0)
    lines: list[str] = []
    for client in clients[:MAX_LINES]:
        lines += _hanging(f"{client.module:{width}} when ", guards.text(client.guard, client.module))
    if len(clients) > MAX_LINES:
        lines.append(f"({len(clients) - MAX_LINES} more modules left out)")
    commanding = {client.module for client in clients}
    guarding = {guard.module for guard in compilation.clients.guards if isinstance(guard, ModuleActive)}
    leaves = [node.module for node in compilation.suppression.nodes if isinstance(node, ModuleLeaf)]
    others = [module for module in leaves if module not in commanding]
    lines += _listed("only in guards: ", [module for module in others if module in guarding])
    lines += _listed("without effect: ", [module for module in others if module not in guarding])
    return lines


def _listed(head: str, names: list[str]) -> list[str]:
    left_out = f" and {len(names) - MAX_LINES} more" if len(names) > MAX_LINES else ""
    return _hanging(head, ", ".join(names[:MAX_LINES]) + left_out) if names else []


# --- tree and traversal --------------------------------------------------------------------------


def _tree(suppression: SuppressionNetwork, root: NodeUse, clients: ActuatorClients) -> list[str]:
    """Return the tree, left child first, so that its leaves are in visiting order.

    A shared node is expanded at its last visit, and only marked at earlier ones.
    """
    nodes = suppression.nodes
    priorities = {client.module: client.priority for client in clients.clients}
    guards = GuardText(suppression.guards)
    last_parents = _last_parents(suppression, root)
    lines: list[str] = []
    stack = [_Branch(link=root)]
    while stack and len(lines) < MAX_LINES:
        branch = stack.pop()
        node = nodes[branch.link.node]
        gate = branch.link.gate
        text = node.module if isinstance(node, ModuleLeaf) else "suppressor"
        if not isinstance(suppression.guards[gate], Always):
            text += f"  when {guards.text(gate)}"
        is_last = last_parents[branch.link.node] == (branch.parent, branch.side)
        if not is_last:
            text += "  (visited again below)"
        elif isinstance(node, ModuleLeaf):
            text += f"  priority {priorities[node.module]}"
        lines.append(branch.prefix + branch.side + text)
        if is_last and not isinstance(node, ModuleLeaf):
            if len(branch.prefix_below) < len(_FORK) * MAX_DEPTH:
                stack += _branches(branch, node)
            else:
                lines.append(f"{branch.prefix_below}... (deeper nodes left out)")
    if stack:
        lines.append("... (the rest is left out)")
    return lines + definitions(guards, MAX_LINES)


_FORK, _TRUNK, _LAST, _BLANK = "├─ ", "│  ", "└─ ", "   "
_LEFT, _RIGHT = "left:  ", "right: "


@dataclass(frozen=True, slots=True, kw_only=True)
class _Branch:
    """A link of the tree that is still to be printed.

    `parent` is the node that uses the link, on its `side`. `prefix` starts the line of the link,
    `prefix_below` those below it.
    """

    link: NodeUse
    parent: int = -1
    side: str = ""
    prefix: str = ""
    prefix_below: str = ""


def _branches(branch: _Branch, node: GatedSuppressor) -> tuple[_Branch, _Branch]:
    """Return the children in stacking order: the left one, last, is printed first."""
    parent, prefix_below = branch.link.node, branch.prefix_below
    right = _Branch(
        link=node.dominant,
        parent=parent,
        side=_RIGHT,
        prefix=prefix_below + _LAST,
        prefix_below=prefix_below + _BLANK,
    )
    left = _Branch(
        link=node.inferior,
        parent=parent,
        side=_LEFT,
        prefix=prefix_below + _FORK,
        prefix_below=prefix_below + _TRUNK,
    )
    return right, left


def _last_parents(suppression: SuppressionNetwork, root: NodeUse) -> dict[int, tuple[int, str]]:
    """Return, for each node, the suppressor and the side by which a forward traversal visits it last."""
    parents: dict[int, tuple[int, str]] = {}
    stack = [(root.node, -1, "")]
    while stack:
        index, parent, side = stack.pop()
        if index in parents:
            continue
        parents[index] = (parent, side)
        node = suppression.nodes[index]
        if not isinstance(node, ModuleLeaf):
            stack.append((node.inferior.node, index, _LEFT))
            stack.append((node.dominant.node, index, _RIGHT))
    return parents


def _visits(clients: ActuatorClients) -> list[str]:
    """Return the modules in visiting order, the lowest priority first."""
    order = [client.module for client in reversed(clients.clients)]
    lines = wrapped(" ".join(order[:MAX_LINES]), _WIDTH)
    if len(order) > MAX_LINES:
        lines.append(f"... ({len(order) - MAX_LINES} more visits left out)")
    return [line if line.startswith("...") else line.replace(" ", "-") for line in lines]
