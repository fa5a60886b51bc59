"""A small building of two floors with an elevator between them."""

from __future__ import annotations

from pathlib import Path

from colony.nav.maps.building import Building, load_building

_FLOOR = """stickrep 1
map    {name}
floor  {floor}
unit   m
start  1 1 270
ring outline 0 0 0
-270 A      W 0 {width}
-270 B      W 0 {length}
-270 C      W 0 {width}
-270 D      W 0 {rest}
 180 liftL  E 0 1.1
 180 liftR  W 0 5
elevator liftL {other}.stickrep liftL
"""


def two_floors(folder: Path) -> Building:
    """Two corridors from west to east, the one above wider, with an elevator in the south wall of each."""
    floors = (("ground", 1, 2.2, 11.0, "upper"), ("upper", 2, 3.0, 13.0, "ground"))
    for name, floor, width, length, other in floors:
        text = _FLOOR.format(
            name=name, floor=floor, width=width, length=length, rest=round(length - 6.1, 1), other=other
        )
        (folder / f"{name}.stickrep").write_text(text)
    return load_building(folder / "ground.stickrep")
