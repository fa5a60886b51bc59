"""The YAML files of grids: what they say, and what is wrong with them, each at its place."""

from __future__ import annotations

import math

import pytest

from colony.nav.maps.grid.keys import GridKeys, OccupancyMode, read_keys
from colony.text.source import Source
from tests.diagnostics import place_of, problems_of
from tests.nav.maps.grid.small_grids import yaml_of


def read(text: str) -> GridKeys:
    return read_keys(Source("map.yaml", text))


def problems(text: str) -> list[str]:
    return [
        f"{place_of(d)}: {d.code} {d.message}" + (f" ({d.hint})" if d.hint else "")
        for d in problems_of(read, text)
    ]


CELL = "`resolution`: expected meters from 0.001 to 10"
ORIGIN = "3:9: M034 `origin`: expected three numbers, [x, y, yaw], in meters and radians"
DOCKS = "7:8: M034 `docks`: expected a list of poses, [[x, y, yaw], ...], in meters and radians"
NO_KEYS = "1:1: M032 expected the keys of a map, such as `image: office.png`"


def test_the_keys_of_map_saver() -> None:
    keys = read(
        "image: office.pgm\nmode: scale\nresolution: 0.050000\norigin: [-10.000000, -1e1, 1.5]\n"
        "negate: 1\noccupied_thresh: 0.65\nfree_thresh: 0.196\n\n"
    )
    assert (keys.image, keys.cell_m, keys.origin) == ("office.pgm", 0.05, (-10.0, -10.0, 1.5))
    assert (keys.negate, keys.occupied_thresh, keys.free_thresh, keys.mode) == (
        True,
        0.65,
        0.196,
        OccupancyMode.SCALE,
    )
    assert keys.image_span.text == "office.pgm"


@pytest.mark.parametrize(
    ("changed", "key", "value"),
    [
        ({"negate": "false"}, "negate", False),
        ({"negate": "Yes"}, "negate", True),
        ({"negate": "2"}, "negate", True),
        ({"mode": "RAW"}, "mode", OccupancyMode.RAW),
        ({"image": "'a: b.png'"}, "image", "a: b.png"),
        ({"image": "!!python/name:os.system x.png"}, "image", "x.png"),
        ({"origin": "\n- -1.5\n- 2\n- -3.1"}, "origin", (-1.5, 2.0, -3.1)),
        ({"resolution": "!!float '.05' # meters"}, "cell_m", 0.05),
        ({"map_type": "occupancy"}, "mode", OccupancyMode.TRINARY),
        ({"docks": "[[1, 2.5, 0], [0, -1, -1.5]]"}, "docks", ((1.0, 2.5, 0.0), (0.0, -1.0, -1.5))),
        ({"docks": "\n- [1, 2, 3]"}, "docks", ((1.0, 2.0, 3.0),)),
        ({"docks": "[]"}, "docks", ()),
        ({"layers": "{a: [1, {b: c}], d: &x [*x]}"}, "mode", OccupancyMode.TRINARY),
    ],
)
def test_a_value_is_read_as_yaml(changed: dict[str, str], key: str, value: object) -> None:
    assert getattr(read(yaml_of(**changed)), key) == value


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"resolution": ".nan"}, f"2:13: M034 {CELL}; found `.nan`"),
        ({"resolution": "0"}, f"2:13: M034 {CELL}; found `0`"),
        ({"resolution": "-inf"}, f"2:13: M034 {CELL}; found `-inf`"),
        ({"resolution": "[1]"}, f"2:13: M034 {CELL}; found a list"),
        (
            {"image": "*other"},
            "1:8: M034 `image`: expected the path of an image; found a mapping or an alias",
        ),
        (
            {"mode": "{raw: 1}"},
            "7:7: M034 `mode`: expected trinary, scale or raw; found a mapping or an alias",
        ),
        ({"origin": "[0, 0]"}, ORIGIN),
        ({"origin": "[[0], 0, 0]"}, ORIGIN),
        ({"origin": "{x: 0}"}, ORIGIN),
        (
            {"origin": "[1e9, 0, 0]"},
            "3:9: M034 `origin`: expected meters from -100000 to 100000; found `1e9`",
        ),
        (
            {"origin": "[0, 0, 90]"},
            "3:9: M034 `origin`: expected a yaw in radians, from -2 pi to 2 pi; found `90`",
        ),
        ({"docks": "[1, 2, 3]"}, DOCKS),
        ({"docks": "[[1, 2, 3], 4]"}, DOCKS),
        ({"docks": "[[1, 2, [3]]]"}, DOCKS),
        ({"docks": "home"}, DOCKS),
        (
            {"docks": "[[1, 2]]"},
            DOCKS.replace("a list of poses, [[x, y, yaw], ...]", "three numbers, [x, y, yaw]"),
        ),
        (
            {"docks": "[[1, 2, 90]]"},
            "7:8: M034 `docks`: expected a yaw in radians, from -2 pi to 2 pi; found `90`",
        ),
        ({"negate": "maybe"}, "4:9: M034 `negate`: expected 0 or 1; found `maybe`"),
        ({"free_thresh": "1.5"}, "6:14: M034 `free_thresh`: expected a number from 0 to 1; found `1.5`"),
        (
            {"free_thresh": "0.7"},
            "6:14: M034 `free_thresh`: expected less than `occupied_thresh`, 0.65; found 0.7",
        ),
        (
            {"mode": "trinery"},
            "7:7: M034 `mode`: expected trinary, scale or raw; found `trinery`; did you mean `trinary`?",
        ),
        ({"image": "''"}, "1:8: M034 `image`: expected the path of an image; found none"),
        ({"negate": None}, "5:19: M035 the key `negate` is missing"),
        ({"modes": "raw"}, "7:1: M033 there is no key `modes` (did you mean `mode`?)"),
    ],
)
def test_what_is_wrong_is_reported_at_its_place(changed: dict[str, str | None], expected: str) -> None:
    assert problems(yaml_of(**changed)) == [expected]


def test_everything_that_is_wrong_is_reported() -> None:
    text = yaml_of(resolution=None, resolutoin="0.05", negate="?!") + "image: other.png\n"
    assert problems(text) == [
        "3:9: M034 `negate`: expected 0 or 1; found `?!`",
        "6:1: M033 there is no key `resolutoin` (did you mean `resolution`?)",
        "7:1: M035 the key `image` was already given",
        "7:17: M035 the key `resolution` is missing",
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", NO_KEYS),
        ("P5 3 3 255\n", NO_KEYS),
        ("- image\n", NO_KEYS),
        ("image: [a\n", "2:1: M032 the text is not YAML: expected ',' or ']', but got '<stream end>'"),
        (
            "image: a\n\tb: c\n",
            "2:1: M032 the text is not YAML: found character '\\t' that cannot start any token",
        ),
        (
            "image: a\n? [b]\n: c\n",
            "2:3: M032 expected the name of a key; found a list, a mapping or an alias",
        ),
        ("image: a\0\n", "1:9: M032 the character U+0000 is not allowed in YAML"),
    ],
)
def test_what_is_not_such_a_file(text: str, expected: str) -> None:
    assert problems(text) == [expected]


def test_bombs_of_aliases_and_depth_are_left_alone() -> None:
    laughs = "a: &a [x, x]\n" + "".join(
        f"{b}: &{b} [*{a}, *{a}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
    )
    assert math.isclose(read(laughs + yaml_of()).cell_m, 0.05)
    assert problems(f"deep: {'[' * 30_000}{']' * 30_000}\n" + yaml_of()) == [
        "1:27: M032 lists and mappings are nested more than 20 deep"
    ]
    assert problems(yaml_of(resolution="&r 0.05", origin="[*r, *r, *r]"))[0].startswith("3:9: M034")
