"""The picture of a network in Mermaid, which pages of Markdown draw."""

from __future__ import annotations

import json

from colony.compile.network import Inhibitor, ModuleLeaf, Network, Suppressor
from colony.text.wording import duration_text
from colony.view.graph.difference import Marks

_HEAD = """  classDef suppressor fill:#dcecfa,stroke:#1f6fb2,color:#111
  classDef inhibitor fill:#fbe3e0,stroke:#b8352a,color:#111
  classDef actuator fill:#22384f,stroke:#22384f,color:#fff
  classDef added fill:#d7f0d7,stroke:#2c8a2c,stroke-width:3px,color:#111
  classDef moved fill:#fff1c9,stroke:#b8860b,stroke-width:3px,color:#111
  classDef removed fill:#f4f4f4,stroke:#999,stroke-dasharray:4,color:#777"""


def to_mermaid(network: Network, title: str = "", marks: Marks | None = None) -> str:
    """Return a Mermaid flowchart: thick arrows are dominant wires, others inferior ones and outputs.

    Failsafe modules have a double border, and named wires their names. With `marks`, added and moved modules
    and added nodes have colors, and removed modules are shown without wires.
    """
    marks = marks or Marks()
    lines = [*(["---", f"title: {json.dumps(title)}", "---"] if title else []), "flowchart LR", _HEAD]
    names: dict[int, list[str]] = {}
    for name, index in network.wires:
        names.setdefault(index, []).append(name)
    for index, node in enumerate(network.nodes):
        style = marks.of_nodes.get(index, "")
        match node:
            case ModuleLeaf(module=module, failsafe=failsafe):
                shape = "[[{}]]" if failsafe else "({})"
                lines.append(f"  n{index}{shape.format(_quoted(module))}{f':::{style}' if style else ''}")
            case Suppressor() | Inhibitor():
                is_suppressor = isinstance(node, Suppressor)
                window = f" {duration_text(node.window_ns)}" if node.window_ns else ""
                label = _quoted(("S" if is_suppressor else "I") + window)
                style = style or ("suppressor" if is_suppressor else "inhibitor")
                lines.append(f"  n{index}(({label})):::{style}")
                lines += [
                    _edge(source, f"n{index}", "==>" if source == node.dominant else "-->", names)
                    for source in dict.fromkeys((node.dominant, node.inferior))
                ]
    for i, (actuator, index) in enumerate(network.outputs):
        lines.append(f"  a{i}[/{_quoted(actuator)}/]:::actuator")
        lines.append(_edge(index, f"a{i}", "-->", names, unless=actuator))
    lines += [f"  r{i}({_quoted(name)}):::removed" for i, name in enumerate(marks.removed)]
    return "\n".join(lines) + "\n"


def _edge(source: int, target: str, arrow: str, names: dict[int, list[str]], unless: str = "") -> str:
    label = ", ".join(name for name in names.get(source, []) if name != unless)
    return f"  n{source} {arrow}{f'|{_quoted(label)}|' if label else ''} {target}"


def _quoted(text: str) -> str:
    return '"{}"'.format(text.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;"))
