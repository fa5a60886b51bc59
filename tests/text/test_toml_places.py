"""The places of keys and values in TOML, held to what tomllib reads."""

from __future__ import annotations

import tomllib

import pytest

from colony.text.toml_places import MAX_DOTS, all_places, places, tables_of

TEXT = '''# first
a = "x"  # with a comment
"quoted key".'inner'  =  1
b.c . d = 2.5
[table]  # of a site
e = """several
lines " and = [quotes]"""""
f = [1, [2, "]"], { g = "}" },
  # a comment in an array: k = 1
  3]
h = { i = "1 m", j.k = true, l = { m = 1979-05-27 07:32:00 } }
[ "odd.table" . sub ]
n = \'\'\'raw \\ text\'\'\'
[[many]]
o = 1
[[many]]
o = 2
[last]
p=-1e3
'''


def shown(text: str) -> dict[str, tuple[str, str]]:
    return {
        "/".join(path): (text[slice(*place.key)], text[slice(*place.value)])
        for path, place in places(text).items()
    }


def test_tables_have_places_too() -> None:
    tables = {path: place for path, place in all_places(TEXT).items() if place.is_table}
    assert {"/".join(path): TEXT[slice(*place.key)] for path, place in tables.items()} == {
        "table": "table",
        "table/h": "h",
        "table/h/l": "l",
        "odd.table/sub": '"odd.table" . sub',
        "last": "last",
    }


def test_every_kind_of_key_and_value_has_its_place() -> None:
    found = shown(TEXT)
    assert found["a"] == ("a", '"x"')
    assert found["quoted key/inner"] == ("\"quoted key\".'inner'", "1")
    assert found["b/c/d"] == ("b.c . d", "2.5")
    assert found["table/e"][1].endswith('[quotes]"""""')
    assert found["table/f"][1].endswith("3]")
    assert found["table/h/i"] == ("i", '"1 m"')
    assert found["table/h/j/k"] == ("j.k", "true")
    assert found["table/h/l/m"] == ("m", "1979-05-27 07:32:00")
    assert found["odd.table/sub/n"] == ("n", "'''raw \\ text'''")
    assert found["many"] == ("many", "many")
    assert found["last/p"] == ("p", "-1e3")


def test_values_are_those_of_tomllib() -> None:
    tables = tomllib.loads(TEXT)
    for path, place in places(TEXT).items():
        value: object = tables
        for part in path:
            value = value[part] if isinstance(value, dict) else None
        if value is not None and not isinstance(value, list):
            assert tomllib.loads(f"x = {TEXT[slice(*place.value)]}")["x"] == value, path


@pytest.mark.parametrize("text", ["a = 1\r\nb = 2\r\n", "a = 1\n\n\tb = 2", "a=1\n#c\nb=2 # x"])
def test_lines_end_in_any_way(text: str) -> None:
    assert shown(text) == {"a": ("a", "1"), "b": ("b", "2")}


@pytest.mark.parametrize("text", ["= 1", "a = ", "[a", 'a = "', "a = { b", "a = [1, "])
def test_places_of_invalid_toml_are_found_in_finite_time(text: str) -> None:
    assert "zzz" not in places(text)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a." * (MAX_DOTS + 1) + "a = 1", "a key has more than 100 dots"),
        ("[" + " . ".join(["a"] * (MAX_DOTS + 2)) + "]", "a key has more than 100 dots"),
        ("a = " + "[" * 5000, "it nests too deep"),
        ("a = " + "9" * 5000, "digits"),
        ("a = b", "Invalid value"),
    ],
)
def test_a_text_beyond_the_limits_is_refused(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        tables_of(text)


def test_many_numbers_and_versions_in_a_line_are_no_long_key() -> None:
    numbers = ", ".join(["1.5", '"a>=1.2.3"'] * MAX_DOTS)
    assert len(tables_of(f"a = [{numbers}]")["a"]) == 2 * MAX_DOTS  # type: ignore[arg-type]
