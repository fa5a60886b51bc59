"""Writes StickRep maps, with the unit and the convention for light offsets that each map names."""

from __future__ import annotations

from colony.nav.maps.stickrep.fields import LENGTH_UNITS
from colony.nav.maps.stickrep.model import Edge, Map, MapNode, Pose, Ring, Site
from colony.nav.maps.stickrep.reader import FORMAT_VERSION

_DECIMALS = 6
_COLUMNS = ("# alpha", "node", "type", "lights", "length", "attribute")


def write_map(source: Map) -> str:
    """Return the text of a map; reading it gives the map back, up to the sixth decimal of its unit.

    Reading and writing a written text again reproduces it. Comments are not kept.
    """
    scale = LENGTH_UNITS[source.unit]
    header = [
        f"stickrep {FORMAT_VERSION}",
        f"map {source.name}",
        f"unit {source.unit}",
        f"lights {source.light_offsets}",
        f"closure {_number(source.tolerance_mm / scale)}",
        *([f"floor {source.floor}"] if source.floor else []),
        *([f"travel {source.travel}"] if source.travel != "either" else []),
        f"start {_pose(source.start, scale)}",
    ]
    connections = [f"link {_site(link.first, scale)} {_site(link.second, scale)}" for link in source.links]
    connections += [f"elevator {link.node} {link.file} {link.other_node}" for link in source.elevators]
    connections += [f"hole {' '.join(_number(value / scale) for value in hole)}" for hole in source.holes]
    connections += [f"dock {_pose(dock, scale)}" for dock in source.docks]
    rings = [_ring(ring, scale, source.light_offsets == "cumulative") for ring in source.rings]
    return "\n\n".join(["\n".join(header), *rings, *(["\n".join(connections)] if connections else [])]) + "\n"


def _ring(ring: Ring, scale: float, cumulative: bool) -> str:
    rows = [
        (
            *_node(node),
            edge.kind.value,
            _lights(edge, scale, cumulative),
            _length(edge, scale),
            edge.attribute,
        )
        for node, edge in zip(ring.nodes, ring.edges, strict=True)
    ]
    table = [_COLUMNS, *rows]
    widths = [max(len(row[column]) for row in table) for column in range(len(_COLUMNS))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in table
    ]
    return "\n".join([f"ring {ring.name} {_pose(ring.start, scale)}", *lines])


def _site(site: Site, scale: float) -> str:
    offset = _number(site.offset_mm / scale)
    return site.node if offset == "0" else f"{site.node}+{offset}"


def _pose(pose: Pose, scale: float) -> str:
    # A heading just below 360 may round up to it, and would then be read as 0.
    heading = _number(round(pose.heading_deg, _DECIMALS) % 360.0)
    return f"{_number(pose.x_mm / scale)} {_number(pose.y_mm / scale)} {heading}"


def _node(node: MapNode) -> tuple[str, str]:
    return ("-" if node.corner else "") + _number(node.angle_deg), node.name


def _lights(edge: Edge, scale: float, cumulative: bool) -> str:
    words, last = [str(len(edge.lights))], 0.0
    for light in edge.lights:
        offset = _number((light.offset_mm - last) / scale)
        words.append(f"-{offset}" if light.shared else offset)
        last = 0.0 if cumulative else light.offset_mm
    return " ".join(words)


def _length(edge: Edge, scale: float) -> str:
    return ("" if edge.counted else "-") + _number(edge.length_mm / scale)


def _number(value: float) -> str:
    text = f"{value:.{_DECIMALS}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text
