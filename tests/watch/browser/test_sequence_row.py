"""A sequence in a real browser: a row of its tasks, with the present one marked."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import load_text
from colony.execute.compiled import SourceFile
from colony.ir.frame import Frame
from tests.analysis.recorded_runs import MS, as_mcap, logs
from tests.waiting import until
from tests.watch.browser.chromium import SIZES, Browser, needs_chromium
from tests.watch.runs import recorded_run, served

pytestmark = [pytest.mark.long, needs_chromium]

TEXT = """
robot porter {
  frame 100 ms
  sensor ordered : bool from DServer.Ordered
  sensor shelf : bool from DServer.AtShelf
  sensor lifted : bool from DServer.Lifted
  sensor bump : bool from RServer.bumper
  actuator drive { velocity : mm/s range -400 .. 400, turn : deg/s range -90 .. 90 }
           to RServer.drive idle drive(velocity = 0, turn = 0)
  actuator mast { up : bool } to DServer.Mast idle hold
}
module go { input speed : mm/s  when true do drive(velocity = speed, turn = 0) }
module lift { when true do mast(up = true) }
module back_off { when bump do drive(velocity = -100 mm/s, turn = 0) }
sequence deliver when ordered {
  go_to_shelf = go(speed = 300 mm/s)   until shelf      within 60 s else give_up
  lift                                 until lifted     within 300 ms else give_up
  go_home     = go(speed = -300 mm/s)  until not shelf  within 60 s else give_up
}
module lower { when deliver == deliver.give_up do mast(up = false) }
network { drive = back_off suppresses deliver.drive  mast = lower suppresses deliver.mast }
"""

PROGRAM = load_text(TEXT)


def frame(k: int) -> Frame:
    """Return a frame: ordered from 0.2 s, at the shelf from 0.5 s; nothing is ever lifted."""
    readings = {"ordered": k >= 2, "shelf": k >= 5, "lifted": False, "bump": k == 4}
    return Frame(k * 100 * MS, readings)


PRESENT = "return [...document.querySelectorAll('.sequence [aria-current]')].map((n) => n.textContent).join()"


def test_the_present_task_is_marked(browser: Browser, tmp_path: Path) -> None:
    source = SourceFile(kind="behavior", path="b.colony", data=TEXT.encode())
    content = as_mcap(PROGRAM, logs(PROGRAM, [frame(k) for k in range(14)]), source).content
    with recorded_run(PROGRAM, content) as watched, served(watched) as server:
        browser.open(server.url)
        until(lambda: "frame" in browser.text("#clock"), "a frame is shown")
        if browser.run("return document.querySelector('#play').ariaLabel") == "pause":
            browser.press(" ")
        browser.press("\ue011")  # home
        for k in range(14):
            until(lambda k=k: browser.text("#clock").endswith(f"frame {k}"), f"frame {k}")  # type: ignore[misc]
            ends = {
                2: "waiting",
                6: "go_to_shelf",
                10: "lift",
                99: "give_up",
            }  # after it
            assert browser.run(PRESENT) == next(phase for end, phase in ends.items() if k < end), k
            if k == 8:
                for size in SIZES:
                    browser.resize(size)
                    browser.picture(tmp_path / f"{size}.png")
            browser.press("\ue014")  # right
        kinds = browser.run(
            "return [...document.querySelectorAll('.sequence ol li')].map((n) => n.className)"
        )
        assert kinds == ["end", "task", "task", "task", "end", "end"]
        assert browser.errors() == []
