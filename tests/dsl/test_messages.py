"""What common slips are told: the message names what was found, the hint what was probably meant."""

from __future__ import annotations

import re

import pytest

from colony.dsl.load import check_text
from tests.dsl.texts import MODULES, findings, messages

PARTS = MODULES.split("network")[0]
SLIPS = [
    # text, the end of the headline, the hint
    ("modul m { when true }", "found `modul`", "did you mean `module`?"),
    ("module m { wen true }", "expected `input`, `let`, `next`, `param`, `state`", "did you mean `when`?"),
    ("module m { do lamp(on = true) }", "found `do`", "`when` comes before `do`; write `when true`"),
    ("module m { when true let a = 1 }", "found `let`", "`let` belongs before `when`"),
    ("module m { when bumper when true }", "found `when`", "a module has one `when`"),
    ("sequence d { lift within 10 s else x }", "expected `=` or `until`", "a task is written `NAME"),
    ("sequence d { lift until b within 1 s }", "an operator or `else`", "a task is written"),
    ("sequence d when b restarts { lift until b }", "`restart` or `{`", "did you mean `restart`?"),
    ("let a = b == 3 == c", "found `==`", "comparisons do not chain"),
    ("let a = b = 3", "found `=`", "compare with `==`"),
    ("let a == 3", "found `==`, expected `=`", "a single `=` gives something a value"),
    ("let a = if b then 1", "expected an operator or `else`", ""),
    ("let a = 1 + if b then 1 else 2", "found `if`", "needs parentheses"),
    ("let a = b && c", "found `&&`", "write `and`"),
    ("let a = b || c", "found `||`", "write `or`"),
    ("let a = !b", "found `!`", "write `not`"),
    ("let a = 3;", "found `;`", "clauses have no terminator"),
    ("let a = b % 2", "found `%`", "write `mod(x, y)`"),
    ("let a = b ** 2", "found `**`", "powers of numbers"),
    ("let a = b ^ 2", "found `^`", "powers are allowed only in units"),
    ("let a = 20%", "found `%`", "write `20 percent`"),
    ("module m { when b > 0.5 % do lamp(on = true) }", "found `%`", "write `0.5 percent`"),
    ("let a = b > 0.5% and c", "found `%`", "write `0.5 percent`"),
    ("module m { when b for 400 ms do lamp(on = true) }", "found `for`", "`recently(..., 400 ms)`"),
    ("reach r in time: b", "found `in`", "leave out `in time`"),
    ("let a = 20 % 3", "found `%`", "write `mod(x, y)`"),
    ("let a = b ? 1 : 2", "found `?`", "write `if CONDITION then A else B`"),
    ("let a = sonar[1:3]", "found `:`", "a slice is written `sonar[1..3]`"),
    ("let a := 3", "found `:`, expected `(` or `=`", "write `=`"),
    ("def f(x) = x", "found `def`", "`let NAME(PARAMETER : TYPE, ...) = EXPRESSION`"),
    ("while true { }", "found `while`", "there are no loops"),
    ("network { drive = a supresses b }", "found `supresses`, expected `suppresses`", "mean `suppresses`?"),
    ("network { drive = a inhibit b }", "found `inhibit`, expected", "did you mean `inhibits`?"),
    ("network { drive = (a inhibts b) }", "found `inhibts`", "did you mean `inhibits`?"),
    ("network { w = a inhibited b }", "found `inhibited`", "did you mean `inhibits`?"),
    ("let a = 'text'", "found `'`", "double quotes"),
    ('let a = "text"', 'found `"text"`', "texts in quotes stand only after"),
    ("let a = 5 lb", "found `lb`", "`lb` is not a unit"),
    ("let a = 3 metres", "found `metres`", "`metres` is not a unit"),
    ("let a = .5", "found `.`", "a digit before the point"),
    ("let a = 5.", "found `.`", "a digit after the point"),
    ("let a = 0x1F", "found `x1F`", "numbers are decimal"),
    ("let a = 1_000", "found `_000`", "numbers are decimal"),
    ("let a = α", "found `α`", "names are made of the letters"),
    ("let if = 3", "found `if`", "`if` is a reserved word"),
    ("// comment", "found `//`", "comments begin with `#`"),
    ("sensor s : mm", "found `sensor`", "inside `robot NAME { ... }`"),
    ("when true", "found `when`", "inside `module NAME { ... }`"),
    ("test 'x' { }", "found `'`", "double quotes"),
    ("test “x” { }", "found `“`", "a straight double quote"),
    ('test "x { }', "the text that begins here is not closed on its line", "add the missing `\"`"),
    ('test "x" { at 0 s, given bumper = true }', "found `,`", "there is no comma before `given`"),
    ('test "x" { at 0 s given bumper == true }', "found `==`, expected `=`", "a single `=`"),
    ("contract c: drive is by avoid", "found `by`", "write `ACTUATOR by MODULE`"),
    ("contract c: drive is not idle", "found `not`", "write `not (drive is idle)`"),
    ("contract c: drive is comanded", "found `comanded`", "did you mean `commanded`?"),
    ("contract c = bumper", "found `=`, expected `:`", ""),
    ("contract c in frame: bumper", "found `frame`, expected `time`", ""),
    ("reach r in time: bumper", "found `in`, expected `:`", ""),
    ("reach r: 1", "a reach", ""),
    ("contract c: bumper reach c: bumper", "reach `c` is declared twice", ""),
    ("reach c: bumper contract c: bumper", "contract `c` is declared twice", ""),
    ("let a = drive.velocity", "can be read only in contracts", ""),
    ("network { a suppresses b }", "found `suppresses`, expected `=`", "name the wire"),
    ("module m { when a suppresses b }", "found `suppresses`", "wired in a `network { ... }` block"),
    ("machine m { start a a => b when true }", "found `=>`, expected `->`", "`a -> b when CONDITION`"),
    ("robot r { sensor a : mm / s from A.b }", "found `/`", "a unit is written without spaces: `mm/s`"),
    ("module m { when (bumper }", "found `}` before the `(` is closed", "missing `)`"),
    ("module m { when true\nmodule n { when true }", "`module` begins a declaration before", "missing `}`"),
    ("network {\n  a = b\nlimit drive.velocity <= 0", "`limit` begins a declaration before", "missing `}`"),
    ("let a = 1 +\nlet b = 2", "`let` begins a declaration, and the one before it is not complete", ""),
    # forms of declarations
    ("let near(r, limit : mm) = r < limit", "found `,`, expected `:` or `[`", "for example `r : mm`"),
    ("module t { input side when side < 1 m }", "found `when`, expected `:` or `[`", "`input side : mm`"),
    ("robot r { sensor a from A.b }", "found `from`, expected `:` or `[`", "`sensor a : mm`"),
    ("let wide(scan : m[]) = min(scan) > 1 m", "found `[`", "after the name: `scan[] : m`"),
    ("module t { input scan : m[8] when true }", "found `[`", "after the name: `scan[8] : m`"),
    ("robot r { sensor scan : m/s[8] from A.b }", "found `[`", "after the name: `scan[8] : m/s`"),
    ("let f(x : m) : m = x", "found `:`, expected `=`", "the type of the result is not written"),
    ("let f(x : m) -> m = x", "found `->`, expected `=`", "the type of the result is not written"),
    ("let x : m = 1 m", "found `:`, expected `(` or `=`", "the type of a `let` is not written"),
    ("module l = avoid(1 m)", "found `1`", "inputs and params are given by name: `avoid(NAME = VALUE)`"),
    ("module l = avoid(near)", "found `)`, expected `=`", "given by name: `avoid(NAME = VALUE)`"),
    ("module l = avoid(min(scan))", "found `(`", "given by name: `avoid(NAME = VALUE)`"),
    ("module l = avoid(scan[0 deg])", "found `[`", "given by name: `avoid(NAME = VALUE)`"),
    ("module l = avoid(far - 1 m)", "found `-`", "given by name: `avoid(NAME = VALUE)`"),
    ("module l = avoid(-1 m)", "found `-`", "given by name: `avoid(NAME = VALUE)`"),
    ("module m { when true do lamp(true) }", "found `true`", "by name: `lamp(FIELD = VALUE)`"),
    ("module t(side : mm) { when true }", "found `(`", "inside: `module t { input NAME : TYPE ... }`"),
    ("network { drive = avoid(clearance = 1 m) }", "found `(`", "`module NAME = avoid(...)`"),
    ("let a = min([r for r in sonar])", "found `[`", "a reduction has no brackets"),
    ("let a = [1, 2]", "found `[`", "there are no lists of values"),
    ("let a = min(r for (r, a) in infrared)", "found `(`, expected a name", "`for r, a in ranges`"),
    ("let a = min(r for r in sonar where r > 1 m)", "found `where`", "write `if`"),
    ("let a = min(r for r in sonar when r > 1 m)", "found `when`", "write `if`"),
    ("let a = any(infrared[0 deg : 30 deg])", "found `:`", "`sonar[-30 deg .. 30 deg]`, with both ends"),
    ("robot r { sensor k[8] : m from P.k bearing 0 deg }", "found `bearing`", "the order is: type"),
    ("robot r { sensor k : m range 0 .. 1 range 0 .. 2 from P.k }", "found `range`", "`range` is given once"),
    ("robot r { sensor k[8] : m bearing 0 .. 90 deg from P.k }", "found `..`", "`bearing 0 deg step 30 deg`"),
    ('import robot "scout"', 'found `"scout"`', "`import robot` takes no name"),
    ("import robot as r", "found `as`", "`import robot` takes no alias"),
    ("contract c: drive.turn > 0 when bumper # !", "found `when`", "first: `bumper implies ...`"),
    # names
    ("let a = len(sonar)", "unknown function `len`", "the length of an array is declared"),
    ("let a = avg(sonar)", "unknown function `avg`", "write `mean`"),
    ("let a = argmin(sonar)", "unknown function `argmin`", "write `index_of_min`"),
    ("let a = argmax(sonar)", "unknown function `argmax`", "write `index_of_max`"),
    ("let a = bumpr", "unknown name `bumpr`", "did you mean `bumper`?"),
    ("let a = True", "unknown name `True`", "write `true`"),
    ("let a = recently", "unknown name `recently`", "it is a function: `recently(...)`"),
    ("let a = held(bumper, 1 s)", "unknown function `held`", "`sustained(b, D)` once b has been true"),
    ("let a = foor(3)", "unknown function `foor`", "did you mean `floor`?"),
    ("enum g { light = 1 } let a = light", "unknown name `light`", "did you mean `g.light`?"),
    ("let a = drive", "`drive` is an actuator, not a value", "only contracts and tests can refer to it"),
    ("let a = cruise", "`cruise` is a module, not a value", "only contracts and tests can refer to it"),
    ("contract c: drive", "`drive` is an actuator, not a value", "write `drive is commanded`"),
    ("contract c: avoid", "`avoid` is a module, not a value", "write `avoid is active`"),
    ("let a = avoid.near", "`avoid.near` can be read only in contracts", "share values through file-level"),
    ("let b = a let a = 3", "`a` is used before it is declared", "declare it above"),
    ("param p = bumper", "`bumper` is not constant", "use literals, params and arithmetic"),
    ("network { w = bumper suppresses avoid }", "`bumper` is a value, not a module, wire", "`when`"),
    ("network { w = drive suppresses avoid }", "`drive` is an actuator", "a name of its own"),
    ("module m { when true do drve(velocity = 0) }", "unknown actuator `drve`", "did you mean `drive`?"),
    ("module m { when true do drive(velocity = 0) }", "does not give `turn` of `drive`", ""),
    ("module m { when true do drive(velocty = 0, turn = 0) }", "no field `velocty`", "mean `velocity`?"),
    # types
    ("module l = avoid(clearance = sonar[1])", "`clearance` must be constant", "as `input clearance : mm`"),
    ("let a = recently(bumper, -2)", "the duration of `recently` is negative", "a duration is at least 0"),
    ("let a = sonar < 3", "`<` needs two numbers of one dimension", "unit: `3 mm`, `3 cm` or `3 m`"),
    ("let a = sonar[0] + docked_at", "a value in mm and a plain number", "`x / 1 mm` is a plain number"),
    ("let a = sonar[0] + heading", "found a value in mm and a value in deg", ""),
    ("let a = 3 kg + 3 N", "found a value in kg and a value in N", ""),
    ("let a = bumper + bumper", "found a bool and a bool", "`if b then 1 else 0`"),
    ("let a = recently(bumper, 2)", "must be a value in s, found a plain number", "`2 ms`, `2 s` or"),
    ("module m { when sonar < 1 m }", "found an array of 24 bools", "`any(...)` or `all(...)`"),
    ("let a = count(sonar)", "`count` takes bools, found a value in mm", "compare first"),
    ("let a = sum(infrared)", "`sum` takes numbers, found a bool", "count bools with `count`"),
    ("let a = sqrt(sonar[0])", "the square root of a value in mm has no unit", "such as `a * a`"),
    ("let a = mod(3)", "`mod` takes 2 arguments, found 1", "use: mod(x, y)"),
    ("let a = min(sonar, 1 m)", "takes one array or several scalars", "first: `min(min(sonar), 1 m)`"),
    ("let a = max(sonar, 2 * sonar)", "one array or several", "first: `max(max(sonar), max(2 * sonar))`"),
    ("network { d = avoid suppresses cruise inhibits avoid }", "mixed without parentheses",
     "write `avoid suppresses (cruise inhibits avoid)` or `(avoid suppresses cruise) inhibits avoid`"),
    ("let a = \u22123", "found `\u2212`, expected an expression", "write `-`; this is U+2212 (minus sign)"),
    ("let a = 5 \u2013 3", "found `\u2013`", "write `-`; this is U+2013 (en dash)"),
    ("let a = 2 \u00d7 3", "found `\u00d7`", "write `*`; this is U+00D7"),
    ("let a = 6 \u00f7 3", "found `\u00f7`", "write `/`; this is U+00F7"),
    ("let a = sonar[0] \u2264 3 m", "found `\u2264`", "write `<=`; this is U+2264"),
    ("let a = sonar[0] \u2265 3 m", "found `\u2265`", "write `>=`; this is U+2265"),
    ("let a = bumper \u2260 true", "found `\u2260`", "write `!=`; this is U+2260"),
    ("let a = bumper \u2227 bumper", "found `\u2227`", "write `and`; this is U+2227"),
    ("let a = \u00ac bumper", "found `\u00ac`", "write `not`; this is U+00AC"),
    ("let a = sonar[0 \u2026 3]", "found `\u2026`", "write `..`; this is U+2026"),
    ("machine m { start one one \u2192 two when bumper }", "found `\u2192`", "write `->`; this is U+2192"),
    ("let a\u00a0= 3", "found the character U+00A0", "write a plain space; this is U+00A0 (no-break space)"),
    ("let a = 3\u202fm", "found the character U+202F", "write a plain space; this is U+202F"),
    ("let a\u200b = 3", "found the character U+200B", "remove it: it is U+200B (zero width space)"),
    ("let a \uff1d 3", "found `\uff1d`", "write `=`; this is U+FF1D (fullwidth equals sign)"),
    ("let a = \uff13", "found `\uff13`", "write `3`; this is U+FF13"),
    ("let a = 3\uff1b", "found `\uff1b`", "leave the `;` out"),
    ("import \u201crome\u201d", "found `\u201c`", "write a straight double quote; this is U+201C"),
    ("import \u2018rome\u2019", "found `\u2018`", "write a straight double quote; this is U+2018"),
    ("let a = 90\u00b0", "found `\u00b0`", "write `deg`; this is U+00B0 (degree sign)"),
    ("let a = 20 \u00b0C", "found `\u00b0`", "write `degC` for `\u00b0C`; this is U+00B0"),
    ("let a = 3 m/s\u00b2", "found `\u00b2`", "write `^2`, in units alone; this is U+00B2"),
    ("let a = 3 \u00b5s", "found `\u00b5`", "1 \u00b5s is `0.001 ms`"),
    ("let a = 3 \u03bcm", "found `\u03bc`", "1 \u03bcm is `0.001 mm`"),
    ("let \u0430 = 3", "found `\u0430`", "and `_`; this is U+0430 (cyrillic small letter a)"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message", "hint"), SLIPS, ids=[text[:40] for text, _, _ in SLIPS])
def test_a_slip_is_one_error_with_its_hint(text: str, message: str, hint: str) -> None:
    shown = messages(f"{text}\n{PARTS}")
    first = re.split(r"\n<text>:\S+ error", shown)[0]
    headline, _, rest = first.partition("\n")
    assert message in headline, shown
    assert hint in rest.rpartition("hint: ")[2], shown
    assert shown.count(": error[") == 1, shown


def test_a_scan_whose_last_reading_repeats_the_first_drops_it() -> None:
    shown = messages("robot r { sensor k[361] : m bearing -180 deg step 1 deg from P.k }", robot="")
    assert "361 elements that are 1 deg apart take more than a full turn" in shown
    assert "hint: the last element looks where the first one does: drop it, and declare 360 elements" in shown


def test_the_first_bearing_without_its_unit() -> None:
    shown = messages("robot r { sensor k[8] : m bearing -90 from P.k }", robot="")
    assert "the first bearing must be a value in deg, found a plain number" in shown
    assert "hint: write its unit: `-90 deg` or `-90 rad`" in shown


def test_an_element_and_its_bearing_that_are_swapped() -> None:
    robot = """
robot r {
  sensor   ranges[8] : m bearing 0 deg from P.k
  actuator drive { velocity : mm/s } to R.drive idle hold
}
"""
    shown = messages("let ahead = min(r * cos(a) for a, r in ranges)", robot)
    assert "`cos` takes an angle, found a value in mm" in shown
    assert "hint: the element comes first, then its bearing: `for r, a in ranges`" in shown
    assert "comes first" not in messages("let ahead = min(cos(r) for r in ranges)", robot)


def test_the_end_of_the_file() -> None:
    shown = messages("module m { when true", robot="")
    assert "the file ends before the `{` is closed" in shown
    assert "hint: add the missing `}`" in shown


@pytest.mark.parametrize(
    "text",
    [
        "let a = nobody let b = a + 1 let c = b module m { let d = c when d > 3 }",
        "param p = nobody param q = p * 2 let a = q",
        "enum g { a = nobody } let x = g.a state s : g = g.a",
        "module m { let a = nobody let b = a state s = 0 next s = b when b > s } network { w = m }",
        "module m { state s : nothing = 3 next s = s + 1 when s > 3 }",
        "module m { when nobody } module n = m module o = n contract c: o is active",
        "module m { when true do nothing(v = 3) } network { drive = m }",
        "network { w = nobody drive = w }",
        "network { w = w x = w drive = x }",
        "module n { when true } network { w = n x = w y = x drive = y }",
        "machine m { start a a -> b when nobody } let x = m == m.b",
        "let x = sum(nobody for k in 0 .. 3) + 1 mm",
        "let x = sonar[nobody] + 3 s",
        "let x = recently(nobody, 1 s) and bumper",
        "limit drive.velocity <= nobody",
        "contract c: nobody is active implies drive.velocity > 0",
        'test "t" { at 0 s given nobody = 3 expect bumper }',
        "import \"nothing.colony\" let a = what + ever network { drive = there suppresses is_there }",
        "import \"nothing.colony\" as n let a = n.what + n.ever module m = n.o(p = 3) network { w = n.p }",
    ],
)  # fmt: skip
def test_one_mistake_is_one_error(text: str) -> None:
    assert len(findings(text)) == 1, messages(text)


def test_a_robot_that_could_not_be_read_is_one_error() -> None:
    text = """
robot r {
  sensor a : mm from A.a
  sensr b : mm from A.b
}
let x = a + b + c
module m { when x > 3 mm do drive(velocity = 0) }
network { drive = m }
contract c: drive.velocity > 0 and drive by m
test "t" { at 0 s given a = 3 expect drive by m }
"""
    assert findings(text, robot="") == ["4:3 E005"]


def test_all_independent_errors_are_told_at_once() -> None:
    text = """let a = one
param b = two
module c { when three do drive(velocity = four, turn = five) }
network { d = six suppresses seven }
limit drive.velocity <= eight when nine
contract e: ten
test "f" { at 0 s given eleven = 1 expect twelve, thirteen }"""
    assert len(findings(text)) == 13


@pytest.mark.long
def test_a_message_is_never_endless() -> None:
    assert len(messages("let a = " + "b" * 100_000)) < 2000
    assert len(messages("let a = sonar" + ".b" * 100_000)) < 2000


TURNED = """robot r {
  sensor rev[8] : mm bearing 0 deg step -45 deg from PServer.a
  sensor lst[5] : mm bearing [90 deg, 0 deg, -90 deg, 0 deg, 40 deg] from PServer.b
  actuator drive { velocity : mm/s } to RServer.drive idle drive(velocity = 0)
}
"""


@pytest.mark.parametrize(
    ("plain", "by_angle"),
    [
        ("rev[0..2]", "rev[-90 deg .. 0 deg]"),
        ("rev[6..1]", "rev[-45 deg .. 90 deg]"),
        ("lst[1]", "lst[0 deg]"),
        ("lst[3]", None),
        ("lst[0..1]", None),
    ],
)
def test_a_plain_index_has_the_hint_that_takes_the_same_elements(plain: str, by_angle: str | None) -> None:
    [found] = [d for d in check_text(f"let a = {plain}\n{TURNED}").diagnostics if d.code == "N002"]
    hint = None if by_angle is None else f"write `{by_angle}`, which means the same on every robot"
    assert found.hint == hint


def test_a_plain_index_in_a_function_is_noted_once_and_of_a_parameter_never() -> None:
    function = "let f(s[] : mm) = s[0] + s[1] + rev[3] let a = f(rev) + f(lst) + f(rev)"
    assert [d.span.text for d in check_text(f"{function}\n{TURNED}").diagnostics if d.code == "N002"] == [
        "rev[3]"
    ]


@pytest.mark.parametrize(
    ("index", "hint"),
    [
        ("scan[-40 .. 40]", "a number without a unit is an index; write `-40 deg .. 40 deg`"),
        ("scan[-w .. w]", "a number without a unit is an index; write `-40 deg .. 40 deg`"),
        ("scan[-40]", "a number without a unit is an index; write `-40 deg`"),
        ("scan[90 .. 100]", "indices wrap in a ring that closes: a sensor with `bearing`"),
        ("plain[-40 .. 40]", "indices wrap in a ring that closes: a sensor with `bearing`"),
    ],
)
def test_numbers_that_were_meant_as_bearings_have_a_hint_that_is_accepted(index: str, hint: str) -> None:
    robot = """language 1
    robot r {
      sensor scan[9] : mm bearing -40 deg step 10 deg from S.scan
      sensor plain[9] : mm from S.plain
      actuator drive { velocity : mm/s } to RServer.drive idle drive(velocity = 0)
    }
    param w = 40
    """
    [found] = [d for d in check_text(f"{robot}let a = {index}").diagnostics if d.code != "W002"]
    assert (found.code, found.hint) == ("E205", hint)
    written = hint.rpartition("write `")[2].rstrip("`")
    if "deg" in written:
        name = index.partition("[")[0]
        assert [d.code for d in check_text(f"{robot}let a = {name}[{written}]").diagnostics] == []
