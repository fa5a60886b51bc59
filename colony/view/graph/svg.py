"""The picture of a network as SVG, laid out by `layout.py`: no other program is needed to draw it.

Modules have `data-module` and nodes `data-node` attributes, so that a live page can highlight them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import accumulate
from xml.sax.saxutils import escape, quoteattr

from colony.compile.network import Inhibitor, ModuleLeaf, Network, Suppressor
from colony.text.wording import duration_text
from colony.view.graph.layout import Connection, Diagram, Layout, Place, layout

MARGIN = 28.0
ROW = 54.0
BETWEEN_DIAGRAMS = 26.0
BOX_HEIGHT = 34.0
RADIUS = 15.0
BEND = 10.0
MIN_PITCH = 66.0
TITLE_HEIGHT = 34.0
LEGEND_LINE = 17.0

_STYLE = """
  text { font-family: "Inter", "Helvetica Neue", "Segoe UI", Arial, sans-serif; fill: #1d2b3a; }
  .title { font-size: 17px; font-weight: 600; }
  .module rect { fill: #ffffff; stroke: #33475b; stroke-width: 1.4; }
  .module text, .stub text, .actuator text { font-size: 13.5px; text-anchor: middle; }
  .stub path { fill: #fdf6e3; stroke: #b58a2a; stroke-width: 1.2; }
  .stub text { font-style: italic; }
  .idle path { stroke-dasharray: 4 3; }
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

    Readable for up to some tens of modules, and linear in the network for any number.
    """
    return _Picture(network, layout(network), title).document()


def text_width(text: str, size: float) -> float:
    """Return a safe estimate of a text's width, in a sans serif type of `size` pixels."""
    return 0.58 * size * len(text)


@dataclass(frozen=True, slots=True)
class _Point:
    x: float
    y: float


class _Picture:
    """Pixels for rows and columns, and the elements in the order in which they are painted."""

    def __init__(self, network: Network, drawn: Layout, title: str) -> None:
        self.network = network
        self.drawn = drawn
        self.title = title
        leaves = [place.name for d in drawn.diagrams for place in d.places if place.column == 0]
        self.box = max([96.0, *(text_width(name, 13.5) + 30 for name in leaves)])
        self.columns = self._columns()
        self.end = max([80.0, *(text_width(d.ends_in, 13.5) + 40 for d in drawn.diagrams)])
        self.top = MARGIN + (TITLE_HEIGHT if title else 0)
        self.tops = {id(d): self.top + i * BETWEEN_DIAGRAMS for i, d in enumerate(drawn.diagrams)}

    def _columns(self) -> list[float]:
        """Return the x of each column (of modules, their right side), and at last that of the actuators."""
        places = [place for d in self.drawn.diagrams for place in d.places]
        pitches = [MIN_PITCH] * (1 + max((place.column for place in places), default=0))
        for d in self.drawn.diagrams:
            short = [d.places[d.root]]  # wires to the next column, on which their names must fit
            for connection in d.connections:
                source, target = d.places[connection.source], d.places[connection.target]
                if target.column == source.column + 1:
                    short.append(source)
            for place in short:
                if place.name:
                    needed = 2 * RADIUS + text_width(place.name, 11.5) + 14
                    pitches[place.column] = max(pitches[place.column], needed)
        pitches[0] = 52.0
        return list(accumulate(pitches, initial=MARGIN + self.box))

    def document(self) -> str:
        elements = [e for d in self.drawn.diagrams for e in self._diagram(d)]
        rows = sum(place.column == 0 for d in self.drawn.diagrams for place in d.places)
        gaps = max(len(self.drawn.diagrams) - 1, 0) * BETWEEN_DIAGRAMS
        bottom = self.top + rows * ROW + gaps + 8
        legend = [
            text for kind, text in _LEGEND.items() if any(isinstance(n, kind) for n in self.network.nodes)
        ]
        legend_width = max((text_width(text, 10) for text in legend), default=0)
        width = max(self._end_x() + self.end + MARGIN, legend_width + 2 * MARGIN)
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

    def _point(self, diagram: Diagram, place: Place) -> _Point:
        return _Point(self.columns[place.column], self.tops[id(diagram)] + (place.row + 0.5) * ROW)

    # --- diagrams ---------------------------------------------------------------------------------

    def _diagram(self, diagram: Diagram) -> list[str]:
        """Draw the wires first, so that nodes are painted over their ends."""
        elements = [self._connection(diagram, connection) for connection in diagram.connections]
        elements.append(self._ending(diagram))
        elements += [self._place(diagram, place) for place in diagram.places]
        return elements

    def _connection(self, diagram: Diagram, connection: Connection) -> str:
        source, target = diagram.places[connection.source], diagram.places[connection.target]
        start, end = self._point(diagram, source), self._point(diagram, target)
        if not connection.dominant:
            path = f"M {_n(start.x)} {_n(start.y)} H {_n(end.x - RADIUS)}"
            return f'<path class="wire" d="{path}" marker-end="url(#inferior)"/>'
        kind = "suppresses" if isinstance(self.network.nodes[target.node], Suppressor) else "inhibits"
        path = (
            f"M {_n(start.x)} {_n(start.y)} H {_n(end.x - BEND)} "
            f"Q {_n(end.x)} {_n(start.y)} {_n(end.x)} {_n(start.y + BEND)} V {_n(end.y - RADIUS)}"
        )
        return f'<path class="wire {kind}" d="{path}" marker-end="url(#{kind})"/>'

    def _ending(self, diagram: Diagram) -> str:
        """Draw the wire that leaves the diagram, and its destination."""
        root = diagram.places[diagram.root]
        start = self._point(diagram, root)
        x = self._end_x() if diagram.actuator else start.x + MIN_PITCH - RADIUS
        wire = f'<path class="wire" d="M {_n(start.x)} {_n(start.y)} H {_n(x)}" marker-end="url(#inferior)"/>'
        if diagram.actuator:
            return f"{wire}\n{_flag('actuator', x, start.y, self.end, diagram.ends_in)}"
        kind = "stub" if diagram.used else "stub idle"
        width = text_width(diagram.ends_in, 13.5) + 34
        return f"{wire}\n{_flag(kind, x, start.y, width, diagram.ends_in)}"

    def _place(self, diagram: Diagram, place: Place) -> str:
        at = self._point(diagram, place)
        node = self.network.nodes[place.node]
        if place.stub:
            return _flag("stub", at.x - self.box, at.y, self.box, place.name)
        match node:
            case ModuleLeaf(module=module):
                return self._module(at, module)
            case Suppressor() | Inhibitor():
                return self._joint(at, node, place)

    def _module(self, at: _Point, module: str) -> str:
        left, top = at.x - self.box, at.y - BOX_HEIGHT / 2
        return (
            f'<g class="module" data-module={quoteattr(module)}><rect x="{_n(left)}" y="{_n(top)}" '
            f'width="{_n(self.box)}" height="{_n(BOX_HEIGHT)}" rx="5"/>'
            f"{_text(left + self.box / 2, at.y + 4.5, module)}</g>"
        )

    def _joint(self, at: _Point, node: Suppressor | Inhibitor, place: Place) -> str:
        kind, letter = ("suppressor", "S") if isinstance(node, Suppressor) else ("inhibitor", "I")
        inside = f'<circle cx="{_n(at.x)}" cy="{_n(at.y)}" r="{_n(RADIUS)}"/>'
        inside += _text(at.x, at.y + 5, letter, "letter")
        if node.window_ns:
            window = duration_text(node.window_ns)
            inside += _text(at.x, at.y + RADIUS + 12, window, "window")
        if place.name:
            inside += _text(at.x + RADIUS + 4, at.y - 6, place.name, "name")
        return f'<g class="{kind}" data-node="{place.node}">{inside}</g>'


_LEGEND = {
    Suppressor: "S: the dominant wire (from above) where it is active, else the inferior one",
    Inhibitor: "I: the inferior wire where the dominant one (from above) is not active",
}


def _n(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")


def _text(x: float, y: float, text: str, kind: str = "") -> str:
    attribute = f' class="{kind}"' if kind else ""
    return f'<text{attribute} x="{_n(x)}" y="{_n(y)}">{escape(text)}</text>'


def _flag(kind: str, x: float, y: float, width: float, text: str) -> str:
    """Draw a box that points to the right: for stubs, named wires and actuators."""
    half, point = BOX_HEIGHT / 2, 11.0
    path = (
        f"M {_n(x + 4)} {_n(y - half)} H {_n(x + width - point)} L {_n(x + width)} {_n(y)} "
        f"L {_n(x + width - point)} {_n(y + half)} H {_n(x + 4)} "
        f"Q {_n(x)} {_n(y + half)} {_n(x)} {_n(y + half - 4)} V {_n(y - half + 4)} "
        f"Q {_n(x)} {_n(y - half)} {_n(x + 4)} {_n(y - half)} Z"
    )
    label = _text(x + (width - point / 2) / 2, y + 4.5, text)
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
