from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ET

import pytest

from colony.compile.network import Inhibitor, ModuleLeaf, Network, Suppressor
from colony.compile.passes.elaborate import elaborate
from colony.view.graph.graph import to_dot, to_mermaid, to_svg
from colony.view.graph.svg import Diagram, Vertex, layout
from tests.networks import chain, ladder, random_program

WANDER = Network(
    nodes=(
        ModuleLeaf(module="avoid"),
        ModuleLeaf(module="cruise"),
        Suppressor(dominant=0, inferior=1, window_ns=1_500_000_000),
        ModuleLeaf(module="docked"),
        Inhibitor(dominant=3, inferior=2),
    ),
    outputs=(("drive", 4),),
    wires=(("roam", 2),),
)
SHARED = Network(
    nodes=(
        ModuleLeaf(module="a"),
        ModuleLeaf(module="b"),
        Suppressor(dominant=0, inferior=1),
        Inhibitor(dominant=0, inferior=2),
        Suppressor(dominant=3, inferior=2),
        Suppressor(dominant=1, inferior=0),
    ),
    outputs=(("drive", 4),),
    wires=(("roam", 2), ("spare", 5)),
)


def names(diagram: Diagram) -> list[str]:
    return [vertex.name for vertex in diagram.vertices]


def test_the_dominant_side_stands_above_and_the_inferior_wire_goes_straight_through() -> None:
    (diagram,) = layout(WANDER).diagrams
    rows = {vertex.node: vertex.row for vertex in diagram.vertices}
    assert rows == {3: 0, 0: 1, 1: 2, 2: 2, 4: 2}
    columns = {vertex.node: vertex.column for vertex in diagram.vertices}
    assert columns == {0: 0, 1: 0, 3: 0, 2: 1, 4: 2}
    assert (diagram.ends_in, diagram.actuator) == ("drive", True)


def test_a_shared_wire_has_a_diagram_of_its_own_and_stubs_where_it_is_used() -> None:
    drive, roam, spare = layout(SHARED).diagrams
    assert [d.ends_in for d in (drive, roam, spare)] == ["drive", "roam", "spare"]
    references = [vertex for vertex in drive.vertices if vertex.is_reference]
    assert [reference.name for reference in references] == ["roam", "roam"]
    assert (roam.used, spare.used) == (True, False)


def test_a_module_is_drawn_once_and_then_named() -> None:
    vertices = [vertex for d in layout(SHARED).diagrams for vertex in d.vertices if not vertex.column]
    boxes = [vertex.name for vertex in vertices if not vertex.is_reference]
    assert sorted(boxes) == ["a", "b"]
    assert [vertex.name for vertex in vertices if vertex.is_reference].count("a") == 2


def test_a_shared_wire_without_a_name_gets_one() -> None:
    nameless = Network(nodes=SHARED.nodes, outputs=SHARED.outputs)
    assert [d.ends_in for d in layout(nameless).diagrams] == ["drive", "wire 1", "wire 2"]


def test_a_wire_that_drives_two_actuators() -> None:
    network = Network(nodes=WANDER.nodes, outputs=(("drive", 4), ("arm", 4)))
    drive, arm, wire = layout(network).diagrams
    assert names(drive) == names(arm) == ["wire 1"]
    assert len(wire.vertices) == 5


@pytest.mark.parametrize("seed", range(20))
def test_no_wire_crosses_another(seed: int) -> None:
    for diagram in layout(elaborate(random_program(20, seed))).diagrams:
        _assert_no_crossing(diagram)


def _assert_no_crossing(diagram: Diagram) -> None:
    """No horizontal piece of wire passes through a vertical one, or through a node."""
    horizontal: list[tuple[int, int, int]] = []  # row, from column, to column
    vertical: list[tuple[int, int, int]] = []  # column, from row, to row
    for connection in diagram.connections:
        source, target = diagram.vertices[connection.source], diagram.vertices[connection.target]
        horizontal.append((source.row, source.column, target.column))
        assert (source.row < target.row) == connection.dominant
        if connection.dominant:
            vertical.append((target.column, source.row, target.row))
    root: Vertex = diagram.vertices[diagram.root]
    horizontal.append((root.row, root.column, sys.maxsize))
    for row, left, right in horizontal:
        assert not any(left < column < right and top < row < bottom for column, top, bottom in vertical)
        assert not any(p.row == row and left < p.column < right for p in diagram.vertices)


def test_svg_is_well_formed_and_has_everything() -> None:
    text = to_svg(WANDER, title="wander & <more>")
    root = ET.fromstring(text)
    space = "{http://www.w3.org/2000/svg}"
    groups = [group.get("class") for group in root.iter(f"{space}g")]
    assert sorted(filter(None, groups)) == [
        "actuator",
        "inhibitor",
        "module",
        "module",
        "module",
        "suppressor",
    ]
    texts = [element.text for element in root.iter(f"{space}text")]
    for expected in ("avoid", "cruise", "docked", "S", "I", "1.5 s", "roam", "drive", "wander & <more>"):
        assert expected in texts
    assert {g.get("data-module") for g in root.iter(f"{space}g")} >= {"avoid", "cruise", "docked"}


def test_everything_is_inside_the_picture() -> None:
    root = ET.fromstring(to_svg(elaborate(random_program(30, seed=1)), title="x"))
    width, height = float(root.get("width", "")), float(root.get("height", ""))
    for path in root.iter("{http://www.w3.org/2000/svg}path"):
        d = path.get("d", "")
        if path.get("fill"):
            continue  # an arrow head
        assert max(map(float, re.findall(r"(?:H|L|M|Q) (-?[\d.]+)", d))) <= width
        assert max(map(float, re.findall(r"V (-?[\d.]+)", d)), default=0) <= height


def test_pictures_are_deterministic_and_take_programs_and_networks() -> None:
    program = random_program(20, seed=2)
    assert to_svg(program) == to_svg(elaborate(program))
    assert to_dot(program) == to_dot(elaborate(program))


def test_large_networks_do_not_recurse_or_explode() -> None:
    for program in (chain(5_000), ladder(2_000)):
        assert len(to_svg(program)) < 10_000_000
        assert len(to_dot(program)) < 10_000_000


def test_an_empty_network() -> None:
    empty = Network(nodes=(), outputs=())
    ET.fromstring(to_svg(empty))
    assert to_dot(empty).startswith("digraph")


def test_dot_has_each_node_and_each_wire() -> None:
    text = to_dot(WANDER, title='say "hi"')
    assert 'label="say \\"hi\\""' in text
    assert "n4 [shape=circle" in text
    for wire in ("n0 -> n2:n", "n1 -> n2:w", "n3 -> n4:n", "n2 -> n4:w", "n4 -> a0"):
        assert wire in text
    assert 'xlabel="roam, 1.5 s"' in text
    assert text.count("{") == text.count("}")


def test_mermaid_has_each_node_and_each_wire() -> None:
    text = to_mermaid(WANDER, title='say "hi"')
    head, _, body = text.partition("flowchart LR\n")
    assert head == '---\ntitle: "say \\"hi\\""\n---\n'
    nodes = {
        "n0": '("avoid")',
        "n1": '("cruise")',
        "n2": '(("S 1.5 s"))',
        "n3": '("docked")',
        "n4": '(("I"))',
    }
    for name, shape in nodes.items():
        assert f"  {name}{shape}" in body
    for wire in ("n0 ==> n2", "n1 --> n2", "n3 ==> n4", 'n2 -->|"roam"| n4', "n4 --> a0"):
        assert f"  {wire}\n" in body
    statements = re.compile(
        r"  (classDef \w+ [\w#:,-]+|\w+(\(\(|\[\[|\[/|\()\"[^\"]*\"(\)\)|\]\]|/\]|\))(:::\w+)?"
        r"|\w+ (-->|==>)(\|\"[^\"]*\"\|)? \w+)"
    )
    assert all(statements.fullmatch(line) for line in body.splitlines())
