"""The picture of a network for Graphviz."""

from __future__ import annotations

from colony.compile.network import Inhibitor, ModuleLeaf, Network, Suppressor
from colony.text.wording import duration_text
from colony.view.graph.difference import Marks

_HEAD = """  rankdir=LR; fontname="Helvetica"; ranksep=0.5; nodesep=0.3;
  node [fontname="Helvetica", fontsize=12];
  edge [color="#6b7c8d", arrowsize=0.6];"""


_MARKS = {
    "added": ', color="#2c8a2c", penwidth=3',
    "moved": ', color="#b8860b", penwidth=3',
    "": "",
}


def to_dot(network: Network, title: str = "", marks: Marks | None = None) -> str:
    """Return a DOT digraph: dominant wires enter their node from above, inferior ones from the left.

    Failsafe modules have a double border. With `marks`, added and moved modules and added nodes have a border
    in a color, and removed modules are shown without wires.
    """
    marks = marks or Marks()
    lines = ["digraph network {", _HEAD]
    if title:
        lines.append(f"  label={_quoted(title)}; labelloc=t;")
    names: dict[int, list[str]] = {}
    for name, index in network.wires:
        names.setdefault(index, []).append(name)
    for index, node in enumerate(network.nodes):
        mark = _MARKS[marks.of_nodes.get(index, "")]
        match node:
            case ModuleLeaf(module=module, failsafe=failsafe):
                border = ", peripheries=2" if failsafe else ""
                lines.append(f"  n{index} [shape=box, style=rounded{border}{mark}, label={_quoted(module)}];")
            case Suppressor() | Inhibitor():
                lines += _node_lines(index, node, names.get(index, []), mark)
    for i, (actuator, index) in enumerate(network.outputs):
        style = 'shape=cds, style=filled, fillcolor="#22384f", fontcolor=white'
        lines += [f"  a{i} [{style}, label={_quoted(actuator)}];", f"  n{index} -> a{i};"]
    removed = 'shape=box, style="rounded,dashed", color="#999999", fontcolor="#777777"'
    lines += [f"  r{i} [{removed}, label={_quoted(name)}];" for i, name in enumerate(marks.removed)]
    return "\n".join([*lines, "}"]) + "\n"


def _node_lines(index: int, node: Suppressor | Inhibitor, names: list[str], mark: str) -> list[str]:
    is_suppressor = isinstance(node, Suppressor)
    letter, color, fill = ("S", "#1f6fb2", "#dcecfa") if is_suppressor else ("I", "#b8352a", "#fbe3e0")
    labels = [*names, *([duration_text(node.window_ns)] if node.window_ns else [])]
    label_attribute = f", xlabel={_quoted(', '.join(labels))}" if labels else ""
    border = mark or f', color="{color}"'
    style = f'shape=circle, width=0.35, fixedsize=true, style=filled{border}, fillcolor="{fill}"'
    return [
        f'  n{index} [{style}, label="{letter}"{label_attribute}];',
        f'  n{node.dominant} -> n{index}:n [color="{color}"];',
        f"  n{node.inferior} -> n{index}:w;",
    ]


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
