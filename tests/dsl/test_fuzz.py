"""Random and damaged texts never raise anything, and where there is no program there is an error."""

from __future__ import annotations

import random
import re

from hypothesis import given
from hypothesis import strategies as st

from colony.dsl.load import check_text
from colony.text.diagnostics import has_errors, render
from tests.dsl.texts import MODULES, ROBOT

GOOD = (
    ROBOT
    + MODULES
    + """
enum goal { none = 0, light = 76 }
param far = 3 m
let ahead = min(sonar[11..13])
let turns = sum(if recently(infrared[k], 1 s) then 1 else 0 for k in 0 .. 23 if k > 3)
state laps = 0
next laps = if rising(bumper) then laps + 1 else laps
machine mode { start one  one -> two when bumper  any -> one when elapsed(mode == mode.two) > 3 s }
module gentle = avoid(clearance = 900 mm)
sequence tour when bumper restart {
  out = avoid(clearance = 1 m) until ahead < far within 10 s else lost
  home = gentle until turns > 3 and not (last.drive by tour.out) within 3 s else out
}
module center from python "a.b:C" { param w = 3.6 m reads sonar, ahead commands drive rate 300 ms }
network { more = center suppresses[1.5 s] gentle suppresses tour.drive }
limit drive.velocity <= 0 when tour == tour.lost
limit drive.velocity <= 100 mm/s when ahead < 1 m
contract safe: drive by avoid implies drive.velocity in 0 .. 1 m/s and not roam is active
test "all" {
  at 0 s given sonar = 3 m, bumper = true expect drive by avoid
  from 1 s to 2 s every 100 ms given sonar[3] = 4, heading = missing
    expect drive is idle, value_or(ahead, 0) > 1 m
}
"""
)
TOKENS = re.findall(r'"[^"\n]*"|[A-Za-z_]\w*|\d[\d.]*|\s+|.', GOOD)
WORDS = sorted({t for t in TOKENS if not t.isspace()})


def survives(text: str) -> None:
    checked = check_text(text)
    assert (checked.program is None) == has_errors(checked.diagnostics)
    for d in checked.diagnostics:
        render(d)


def test_the_text_to_damage_is_good() -> None:
    assert check_text(GOOD).program is not None


@given(st.text())
def test_random_characters(text: str) -> None:
    survives(text)


@given(st.lists(st.sampled_from(WORDS), max_size=60))
def test_random_words(words: list[str]) -> None:
    survives(" ".join(words))


@given(
    st.lists(st.sampled_from(WORDS), max_size=12),
    st.sampled_from(["let x = ", "module m { when ", "network { w = "]),
)
def test_random_words_after_a_beginning(words: list[str], beginning: str) -> None:
    survives(f"{ROBOT}{MODULES}{beginning}{' '.join(words)}")


@given(st.randoms(use_true_random=False))
def test_damaged_programs(choose: random.Random) -> None:
    tokens = list(TOKENS)
    for _ in range(choose.choice([1, 1, 2, 5])):
        at = choose.randrange(len(tokens))
        to = min(len(tokens), at + choose.randrange(1, 30))
        match choose.randrange(5):
            case 0:
                del tokens[at]
            case 1:
                tokens.insert(at, f" {choose.choice(WORDS)} ")
            case 2:
                tokens[at] = choose.choice(WORDS)
            case 3:
                tokens[at:to] = []
            case _:
                tokens[at:at] = tokens[at:to]
    survives("".join(tokens))


@given(st.integers(0, len(GOOD)))
def test_a_program_cut_off_anywhere(at: int) -> None:
    survives(GOOD[:at])
