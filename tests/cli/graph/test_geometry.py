"""The geometry of robots: transforms, their trees, and what a URDF says of hull and wheels."""

from __future__ import annotations

import math

import pytest

from colony.cli.robot.graph.geometry import Frames, Transform, Urdf, of_angles, of_message
from tests.cli.graph.graphs import URDF


def test_transforms_are_applied_after_each_other_and_undone() -> None:
    first, second = of_angles(0.1, 0.2, 0.3, (1.0, 2.0, 3.0)), of_angles(-0.5, 0.0, 2.0, (0.0, -1.0, 0.0))
    point = (0.3, -0.7, 0.2)
    both = first.after(second).apply(point)
    assert both == pytest.approx(first.apply(second.apply(point)))
    assert first.after(second).inverse().apply(both) == pytest.approx(point)


def test_angles_and_quaternions_turn_alike() -> None:
    angles = of_angles(math.pi, 0.0, math.pi / 2, (1.0, 2.0, 3.0))  # upside down, and to the left
    rotation = {"x": math.sqrt(0.5), "y": math.sqrt(0.5), "z": 0.0, "w": 0.0}
    found = of_message({"translation": {"x": 1.0, "y": 2.0, "z": 3.0}, "rotation": rotation})
    assert found.apply((1.0, 0.0, 0.0)) == pytest.approx(angles.apply((1.0, 0.0, 0.0)))
    assert found.apply((0.0, 1.0, 0.5)) == pytest.approx(angles.apply((0.0, 1.0, 0.5)))
    assert of_message(
        {"translation": {"x": 1.0, "y": 0.0, "z": 0.0}, "rotation": dict.fromkeys("xyzw", 0.0)}
    ) == (Transform(place=(1.0, 0.0, 0.0)))


def test_frames_are_connected_by_their_root_and_by_nothing_else() -> None:
    frames = Frames()
    frames.add("base_link", "/laser", of_angles(0, 0, math.pi / 2, (0.1, 0.0, 0.2)))
    frames.add("footprint", "base_link", Transform(place=(0.0, 0.0, 0.05)))
    found = frames.between("footprint", "laser")
    assert found is not None
    assert found.place == pytest.approx((0.1, 0.0, 0.25))
    itself = frames.between("laser", "laser")
    assert itself is not None
    assert itself.apply((1.0, 2.0, 3.0)) == pytest.approx((1.0, 2.0, 3.0))
    assert frames.between("footprint", "camera") is None
    frames.add("a", "b", Transform())
    frames.add("b", "a", Transform())
    assert frames.between("a", "laser") is None


def test_a_urdf_has_hull_and_wheels_but_no_casters() -> None:
    urdf = Urdf(URDF)
    assert urdf.name == "rover"
    radius, height = urdf.hull("base_footprint") or (0.0, 0.0)
    assert radius == pytest.approx(math.hypot(0.102, 0.07))
    assert height == pytest.approx(0.01 + 0.07 + 0.143 / 2)
    assert urdf.wheel_base("base_footprint") == pytest.approx(0.16)
    assert urdf.hull("elsewhere") is None
    assert urdf.wheel_base("elsewhere") is None


@pytest.mark.parametrize(
    ("shape", "radius"),
    [
        ('<cylinder radius="0.3" length="0.1"/>', 0.3),
        ('<sphere radius="0.2"/>', 0.2),
        ('<box size="0.6 0.8 0.1"/>', 0.5),
        ('<box size="1 2"/>', None),
        ('<mesh filename="a.stl"/>', None),
    ],
)
def test_the_hull_is_that_of_simple_shapes(shape: str, radius: float | None) -> None:
    text = (
        f'<robot name="a"><link name="b"><collision><geometry>{shape}</geometry></collision></link></robot>'
    )
    found = Urdf(text).hull("b")
    assert found is None if radius is None else found is not None and found[0] == pytest.approx(radius)


@pytest.mark.parametrize(
    "text",
    [
        "<robot",
        '<!DOCTYPE a [<!ENTITY b "c">]><robot/>',
        '<robot><joint><origin xyz="1 2"/></joint></robot>',
        " " * 5_000_001,
    ],
)
def test_what_is_no_urdf_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"it is|three numbers"):
        Urdf(text)
