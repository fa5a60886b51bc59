"""The picture of a network as SVG, with a layout of its own: no other program is needed to draw it.

A picture for a page, `to_live_svg`, leaves the colors to the page's style sheet, and names what it shows:
modules have `data-module`, nodes and references `data-node`, and wires `data-from` and `data-to` (indices of
nodes, or the name of an actuator), so that the page can highlight them.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from xml.sax.saxutils import escape, quoteattr

from colony.compile.network import Inhibitor, ModuleLeaf, Network, NetworkNode, Suppressor
from colony.text.wording import duration_text

# --- layout -------------------------------------------------------------------------------------------
#
# The layout of a network's diagrams in rows and columns.
#
# As in the figures of the colony literature, wires run to the right, one row per module, dominant side above.
# A node is in the row of its inferior wire, which goes straight through it; the dominant wire ends in
# a later column than anything between the two rows, and enters the node from above without crossing a wire.
#
# A diagram is a tree. A graph is split into several trees. A node that is used more than once gets a diagram
# of its own, which ends in the node's name; each use of it shows a reference, a box with that name. A module
# that is used more than once is shown as a reference, too, except at its first use.


@dataclass(frozen=True, slots=True, kw_only=True)
class Vertex:
    """A module or reference (column 0), or a suppressor or inhibitor (column 1 and beyond).

    `name` is the text in a module or reference, or next to the wire that leaves a node, if it has a name.
    """

    node: int
    row: int
    column: int
    name: str
    is_reference: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnWire:
    """A wire between two vertices, by index: into the target from above if `dominant`, else straight."""

    source: int
    target: int
    dominant: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagram:
    """One tree, whose outgoing wire leads to an actuator or ends in the wire's name, `ends_in`.

    `root` is the index of the vertex that the wire leaves. `used` is false if the wire drives nothing.
    """

    ends_in: str
    actuator: bool
    used: bool
    vertices: tuple[Vertex, ...]
    connections: tuple[DrawnWire, ...]
    root: int


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagramLayout:
    """Diagrams from top to bottom; rows are numbered across all of them."""

    diagrams: tuple[Diagram, ...]


def layout(network: Network) -> DiagramLayout:
    """Lay out actuators in order, then wires that are used several times, then wires that drive nothing."""
    return DiagramLayout(diagrams=tuple(_Drawing(network).diagrams()))


def inputs(node: NetworkNode) -> tuple[int, ...]:
    """Return the dominant and the inferior input, or an empty tuple for a module."""
    return () if isinstance(node, ModuleLeaf) else (node.dominant, node.inferior)


class _Drawing:
    def __init__(self, network: Network) -> None:
        self.nodes = network.nodes
        self.outputs = network.outputs
        uses = Counter(index for node in network.nodes for index in inputs(node))
        uses.update(index for _, index in network.outputs)
        self.unused = [index for index in range(len(self.nodes)) if not uses[index]]
        self.names = {index: name for name, index in reversed(network.wires)}
        shared = [
            index
            for index, node in enumerate(self.nodes)
            if uses[index] > 1 and not isinstance(node, ModuleLeaf)
        ]
        self.shared = set(shared)
        nameless = [index for index in (*shared, *self.unused) if index not in self.names]
        self.names |= {
            index: f"wire {i}" for i, index in enumerate(nameless, start=1) if inputs(self.nodes[index])
        }
        self.shared_queue: deque[int] = deque()
        self.drawn: set[int] = set()
        self.row = 0

    def diagrams(self) -> Iterator[Diagram]:
        for actuator, root in self.outputs:
            yield self.diagram(root, actuator, actuator=True, used=True)
        yield from self.shared_wires()
        for root in self.unused:
            node = self.nodes[root]
            if isinstance(node, ModuleLeaf) and root not in self.names:
                continue  # a module that no wire uses; a contract reads its activity
            yield self.diagram(root, self.names[root], actuator=False, used=False)
            yield from self.shared_wires()

    def shared_wires(self) -> Iterator[Diagram]:
        while self.shared_queue:
            root = self.shared_queue.popleft()
            yield self.diagram(root, self.names[root], actuator=False, used=True)

    def diagram(self, root: int, ends_in: str, *, actuator: bool, used: bool) -> Diagram:
        """Lay out one tree: rows from the dominant side down, each column after those of the inputs."""
        vertices: list[Vertex] = []
        connections: list[DrawnWire] = []
        pending: list[int] = []  # vertices whose node is not laid out yet
        stack = [(root, False)]  # node, and True once its inputs are on the stack
        while stack:
            index, expanded = stack.pop()
            node = self.nodes[index]
            wire_name = self.names.get(index, "")
            if isinstance(node, ModuleLeaf) or (index in self.shared and (index != root or actuator)):
                vertices.append(self.leaf(index, node))
            elif not expanded:
                stack += ((index, True), (node.inferior, False), (node.dominant, False))
                continue
            else:
                inferior, dominant = pending.pop(), pending.pop()
                column = 1 + max(vertices[inferior].column, vertices[dominant].column)
                name = "" if index == root and not actuator else wire_name
                vertices.append(Vertex(node=index, row=vertices[inferior].row, column=column, name=name))
                target = len(vertices) - 1
                connections.append(DrawnWire(source=dominant, target=target, dominant=True))
                connections.append(DrawnWire(source=inferior, target=target, dominant=False))
            pending.append(len(vertices) - 1)
        return Diagram(
            ends_in=ends_in,
            actuator=actuator,
            used=used,
            vertices=tuple(vertices),
            connections=tuple(connections),
            root=pending.pop(),
        )

    def leaf(self, index: int, node: NetworkNode) -> Vertex:
        is_repeated = index in self.drawn
        self.drawn.add(index)
        if isinstance(node, ModuleLeaf):
            name, is_reference = node.module, is_repeated
        else:
            name, is_reference = self.names[index], True
            if not is_repeated:
                self.shared_queue.append(index)
        self.row += 1
        return Vertex(node=index, row=self.row - 1, column=0, name=name, is_reference=is_reference)


# --- svg ----------------------------------------------------------------------------------------------

MARGIN = 28.0
ROW = 54.0
BETWEEN_DIAGRAMS = 26.0
BOX_HEIGHT = 34.0
INNER_BORDER = 3.0
"""Distance between the two borders of a failsafe module."""
RADIUS = 15.0
BEND = 10.0
MIN_PITCH = 66.0
TITLE_HEIGHT = 34.0
LEGEND_LINE = 17.0

_STYLE = """
  text { font-family: "Inter", "Helvetica Neue", "Segoe UI", Arial, sans-serif; fill: #1d2b3a; }
  .title { font-size: 17px; font-weight: 600; }
  .module rect { fill: #ffffff; stroke: #33475b; stroke-width: 1.4; }
  .module text, .reference text, .actuator text { font-size: 13.5px; text-anchor: middle; }
  .reference path { fill: #fdf6e3; stroke: #b58a2a; stroke-width: 1.2; }
  .reference text { font-style: italic; }
  .unused path { stroke-dasharray: 4 3; }
  .actuator path { fill: #22384f; stroke: #22384f; }
  .actuator text { fill: #ffffff; font-weight: 600; }
  .wire { fill: none; stroke: #6b7c8d; stroke-width: 1.6; }
  .wire.suppresses { stroke: #1f6fb2; }
  .wire.inhibits { stroke: #b8352a; }
  .suppressor circle { fill: #dcecfa; stroke: #1f6fb2; stroke-width: 1.8; }
  .suppressor text { fill: #174f80; }
  .inhibitor circle { fill: #fbe3e0; stroke: #b8352a; stroke-width: 1.8; }
  .inhibitor text { fill: #8c231b; }
  .letter { font-size: 14px; font-weight: 700; text-anchor: middle; }
  .window { font-size: 11px; text-anchor: middle; }
  text.name { font-size: 11.5px; font-style: italic; fill: #5a6b7b; }
  text.legend { font-size: 11.5px; fill: #5a6b7b; }
"""


def to_svg(network: Network, title: str = "") -> str:
    """Return an SVG document of the network; the same network always gives the same text.

    Readable for up to a few dozen modules; takes time linear in the size of the network.
    """
    return _Picture(network, title).document()


def to_live_svg(network: Network) -> str:
    """Return an SVG element of the network without colors, title and legend, for a page that animates it."""
    return _Picture(network, "", live=True).document()


def text_width(text: str, size: float) -> float:
    """Return a safe estimate of a text's width, in a sans serif type of `size` pixels."""
    return 0.58 * size * len(text)


@dataclass(frozen=True, slots=True)
class _Point:
    x: float
    y: float


class _Picture:
    """Converts rows and columns to pixels, and emits the elements in painting order."""

    def __init__(self, network: Network, title: str, *, live: bool = False) -> None:
        self.network = network
        self.live = live
        self.diagrams = layout(network).diagrams
        self.title = title
        leaves = [vertex.name for d in self.diagrams for vertex in d.vertices if vertex.column == 0]
        self.box_width = max([96.0, *(text_width(name, 13.5) + 30 for name in leaves)])
        self.columns = self._columns()
        self.end_width = max([80.0, *(text_width(d.ends_in, 13.5) + 40 for d in self.diagrams)])
        self.top = MARGIN + (TITLE_HEIGHT if title else 0)
        self.tops = {id(d): self.top + i * BETWEEN_DIAGRAMS for i, d in enumerate(self.diagrams)}

    def _columns(self) -> list[float]:
        """Return the x of each column (for modules, the right edge), followed by that of the actuators."""
        vertices = [vertex for d in self.diagrams for vertex in d.vertices]
        pitches = [MIN_PITCH] * (1 + max((vertex.column for vertex in vertices), default=0))
        for d in self.diagrams:
            labeled = [
                d.vertices[d.root]
            ]  # the wire ends in the next column, so its name must fit in between
            for connection in d.connections:
                source, target = d.vertices[connection.source], d.vertices[connection.target]
                if target.column == source.column + 1:
                    labeled.append(source)
            for vertex in labeled:
                if vertex.name:
                    needed = 2 * RADIUS + text_width(vertex.name, 11.5) + 14
                    pitches[vertex.column] = max(pitches[vertex.column], needed)
        pitches[0] = 52.0
        return list(accumulate(pitches, initial=MARGIN + self.box_width))

    def document(self) -> str:
        elements = [e for d in self.diagrams for e in self._diagram(d)]
        rows = sum(vertex.column == 0 for d in self.diagrams for vertex in d.vertices)
        gaps = max(len(self.diagrams) - 1, 0) * BETWEEN_DIAGRAMS
        bottom = self.top + rows * ROW + gaps + 8
        legend = [
            text for kind, text in _LEGEND.items() if any(isinstance(n, kind) for n in self.network.nodes)
        ]
        legend += [_FAILSAFE_LEGEND] if self.network.failsafe_modules else []
        legend_width = max((text_width(text, 10) for text in legend), default=0)
        if self.live:
            width, height = self._end_x() + self.end_width + MARGIN, bottom + MARGIN / 2
            head = (
                f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_n(width)} {_n(height)}">{_markers()}'
            )
            return head + "\n".join(elements) + "</svg>"
        width = max(self._end_x() + self.end_width + MARGIN, legend_width + 2 * MARGIN)
        height = bottom + len(legend) * LEGEND_LINE + MARGIN / 2
        title = escape(self.title or "Network")
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_n(width)} {_n(height)}" '
            f'width="{_n(width)}" height="{_n(height)}" role="img">\n'
            f"<title>{title}</title>\n<style>{_STYLE}</style>\n{_markers()}\n"
            f'<rect width="{_n(width)}" height="{_n(height)}" rx="10" fill="#f7f9fb"/>\n'
        )
        if self.title:
            head += f'<text class="title" x="{_n(MARGIN)}" y="{_n(MARGIN + 12)}">{title}</text>\n'
        for i, text in enumerate(legend):
            elements.append(_text(MARGIN, bottom + 10 + i * LEGEND_LINE, text, "legend"))
        return head + "\n".join(elements) + "\n</svg>\n"

    def _end_x(self) -> float:
        """Return the x at which the boxes of actuators begin."""
        return self.columns[-1]

    def _point(self, diagram: Diagram, vertex: Vertex) -> _Point:
        return _Point(self.columns[vertex.column], self.tops[id(diagram)] + (vertex.row + 0.5) * ROW)

    # --- diagrams ---------------------------------------------------------------------------------

    def _diagram(self, diagram: Diagram) -> list[str]:
        """Draw the wires first, so that nodes cover their ends."""
        elements = [self._connection(diagram, connection) for connection in diagram.connections]
        elements.append(self._outgoing_wire(diagram))
        elements += [self._vertex(diagram, vertex) for vertex in diagram.vertices]
        return elements

    def _connection(self, diagram: Diagram, connection: DrawnWire) -> str:
        source, target = diagram.vertices[connection.source], diagram.vertices[connection.target]
        start, end = self._point(diagram, source), self._point(diagram, target)
        if not connection.dominant:
            path = f"M {_n(start.x)} {_n(start.y)} H {_n(end.x - RADIUS)}"
            ends = self._ends(source.node, target.node)
            return f'<path class="wire"{ends} d="{path}" marker-end="url(#inferior)"/>'
        kind = "suppresses" if isinstance(self.network.nodes[target.node], Suppressor) else "inhibits"
        path = (
            f"M {_n(start.x)} {_n(start.y)} H {_n(end.x - BEND)} "
            f"Q {_n(end.x)} {_n(start.y)} {_n(end.x)} {_n(start.y + BEND)} V {_n(end.y - RADIUS)}"
        )
        ends = self._ends(source.node, target.node)
        return f'<path class="wire {kind}"{ends} d="{path}" marker-end="url(#{kind})"/>'

    def _ends(self, source: int, target: int | str) -> str:
        """Return the attributes that name the ends of a wire, for a page."""
        return f" data-from={quoteattr(str(source))} data-to={quoteattr(str(target))}" if self.live else ""

    def _outgoing_wire(self, diagram: Diagram) -> str:
        """Draw the wire that leaves the diagram, and the box at its end."""
        root = diagram.vertices[diagram.root]
        start = self._point(diagram, root)
        x = self._end_x() if diagram.actuator else start.x + MIN_PITCH - RADIUS
        ends = self._ends(root.node, diagram.ends_in)
        path = f"M {_n(start.x)} {_n(start.y)} H {_n(x)}"
        wire = f'<path class="wire"{ends} d="{path}" marker-end="url(#inferior)"/>'
        if diagram.actuator:
            return f"{wire}\n{_flag('actuator', x, start.y, self.end_width, diagram.ends_in)}"
        kind = "reference" if diagram.used else "reference unused"
        width = text_width(diagram.ends_in, 13.5) + 34
        return f"{wire}\n{_flag(kind, x, start.y, width, diagram.ends_in)}"

    def _vertex(self, diagram: Diagram, vertex: Vertex) -> str:
        point = self._point(diagram, vertex)
        node = self.network.nodes[vertex.node]
        if vertex.is_reference:
            left = point.x - self.box_width
            reference = _flag("reference", left, point.y, self.box_width, vertex.name)
            return f'<g data-node="{vertex.node}">{reference}</g>' if self.live else reference
        match node:
            case ModuleLeaf():
                return self._module(point, node)
            case Suppressor() | Inhibitor():
                return self._node_symbol(point, node, vertex)

    def _module(self, point: _Point, leaf: ModuleLeaf) -> str:
        left, top = point.x - self.box_width, point.y - BOX_HEIGHT / 2
        borders = (0, INNER_BORDER) if leaf.failsafe else (0,)
        boxes = "".join(
            f'<rect x="{_n(left + d)}" y="{_n(top + d)}" width="{_n(self.box_width - 2 * d)}" '
            f'height="{_n(BOX_HEIGHT - 2 * d)}" rx="5"/>'
            for d in borders
        )
        text = _text(left + self.box_width / 2, point.y + 4.5, leaf.module)
        return f'<g class="module" data-module={quoteattr(leaf.module)}>{boxes}{text}</g>'

    def _node_symbol(self, point: _Point, node: Suppressor | Inhibitor, vertex: Vertex) -> str:
        kind, letter = ("suppressor", "S") if isinstance(node, Suppressor) else ("inhibitor", "I")
        inside = f'<circle cx="{_n(point.x)}" cy="{_n(point.y)}" r="{_n(RADIUS)}"/>'
        inside += _text(point.x, point.y + 5, letter, "letter")
        if node.window_ns:
            window = duration_text(node.window_ns)
            inside += _text(point.x, point.y + RADIUS + 12, window, "window")
        if vertex.name:
            inside += _text(point.x + RADIUS + 4, point.y - 6, vertex.name, "name")
        return f'<g class="{kind}" data-node="{vertex.node}">{inside}</g>'


_LEGEND = {
    Suppressor: "S: the dominant wire (from above) where it is active, otherwise the inferior one",
    Inhibitor: "I: the inferior wire where the dominant one (from above) is not active",
}
_FAILSAFE_LEGEND = "double border: failsafe, active also where something that it reads is missing"


def _n(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")


def _text(x: float, y: float, text: str, kind: str = "") -> str:
    attribute = f' class="{kind}"' if kind else ""
    return f'<text{attribute} x="{_n(x)}" y="{_n(y)}">{escape(text)}</text>'


def _flag(kind: str, x: float, y: float, width: float, text: str) -> str:
    """Draw a box that points to the right: a reference, the name of a wire at its end, or an actuator."""
    half, tip = BOX_HEIGHT / 2, 11.0
    path = (
        f"M {_n(x + 4)} {_n(y - half)} H {_n(x + width - tip)} L {_n(x + width)} {_n(y)} "
        f"L {_n(x + width - tip)} {_n(y + half)} H {_n(x + 4)} "
        f"Q {_n(x)} {_n(y + half)} {_n(x)} {_n(y + half - 4)} V {_n(y - half + 4)} "
        f"Q {_n(x)} {_n(y - half)} {_n(x + 4)} {_n(y - half)} Z"
    )
    label = _text(x + (width - tip / 2) / 2, y + 4.5, text)
    return f'<g class="{kind}" data-name={quoteattr(text)}><path d="{path}"/>{label}</g>'


def _markers() -> str:
    """Return arrow heads, one for each color of wire."""
    colors = (("inferior", "#6b7c8d"), ("suppresses", "#1f6fb2"), ("inhibits", "#b8352a"))
    heads = (
        f'<marker id="{name}" viewBox="0 0 8 8" refX="7.5" refY="4" markerWidth="5.5" markerHeight="5.5" '
        f'orient="auto"><path d="M 0 0.5 L 8 4 L 0 7.5 Z" fill="{color}"/></marker>'
        for name, color in colors
    )
    return f"<defs>{''.join(heads)}</defs>"
