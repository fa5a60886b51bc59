"""`verify --watch` and `diff --watch`: pages show the run of the proof, and mark where it ends."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from colony.watch.serving import LOOPBACK, user_token
from tests.cli.conftest import Colony
from tests.commands import Ran
from tests.runtime.transport.live.certificates import free_port
from tests.waiting import until
from tests.watch.runs import Page, page

LONG = "contract lasts: drive by back implies bumper\n"
MARKED = 2
"""The mark of a broken contract in a timeline."""

Look = Callable[[Page], None]


@pytest.fixture
def watched(
    colony: Colony, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[[Look, tuple[str | Path, ...]], Ran]:
    """Return a function that runs a command which serves a page, looks at the page, and presses Ctrl-C."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def run(look: Look, arguments: tuple[str | Path, ...]) -> Ran:
        port, seen = free_port(), list[BaseException | None]()

        def visit() -> None:
            try:
                until(lambda: serves(port), "the page is served")
                with page(f"{LOOPBACK}:{port}", token=user_token(os.environ)) as opened:
                    look(opened)
                seen.append(None)
            except BaseException as problem:
                seen.append(problem)
            finally:
                os.kill(os.getpid(), signal.SIGINT)

        visitor = threading.Thread(target=visit)
        visitor.start()
        ran = colony(*arguments, "--port", str(port))
        visitor.join()
        assert seen == [None]
        return ran

    return run


def serves(port: int) -> bool:
    try:
        with page(f"{LOOPBACK}:{port}", token=user_token(os.environ)) as opened:
            opened.until(lambda m: "scene" in m)
        return True
    except OSError:
        return False


def test_the_page_shows_the_run_that_breaks_a_contract(watched: Callable[..., Ran], behavior: Path) -> None:
    behavior.write_text(behavior.read_text() + LONG + "contract fine: true\n")

    def look(opened: Page) -> None:
        scene = opened.until(lambda m: "scene" in m)["scene"]
        assert (scene["title"], scene["contracts"]) == ("b.colony: breaks `lasts`", ["lasts", "fine"])
        marks = opened.until(lambda m: "timeline" in m)["timeline"]["marks"]
        assert [mark & MARKED for mark in marks] == [0, MARKED]
        opened.ask(do="pause")
        opened.ask(do="seek", t=0)
        assert opened.shown(0)["contracts"] == ["held", "held"]
        opened.ask(do="step", frames=1)
        last = opened.shown(1)
        assert (last["contracts"], last["modules"]) == (["broken", "held"], ["silent", "won", "inactive"])
        opened.ask(do="ask", module="back", k=1)
        assert "back" in str(opened.until(lambda m: "answer" in m))

    ran = watched(look, ("verify", behavior, "--watch", "lasts"))
    assert ran.code == 1
    assert "REFUTED  lasts" in ran.out
    assert "b.colony: breaks `lasts`: watch at http" in ran.out


def test_the_page_shows_a_run_that_gets_to_a_reach(watched: Callable[..., Ran], behavior: Path) -> None:
    behavior.write_text(behavior.read_text() + "reach bumps: drive by back and lamp.on\n")

    def look(opened: Page) -> None:
        assert opened.until(lambda m: "scene" in m)["scene"]["contracts"] == ["bumps"]
        assert opened.shown(0)["contracts"] == ["broken"]
        assert opened.until(lambda m: "timeline" in m)["timeline"]["marks"] == [MARKED]

    assert watched(look, ("verify", behavior, "--watch", "bumps")).code == 0


def test_two_pages_show_the_run_in_which_behaviors_differ(
    watched: Callable[..., Ran], behavior: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.colony"
    other.write_text(behavior.read_text().replace("-100 mm/s", "-90 mm/s"))

    def look(opened: Page) -> None:
        assert opened.until(lambda m: "scene" in m)["scene"]["title"] == "A, b.colony"
        assert opened.shown(0)["commands"][0]["sent"][0] == -100

    ran = watched(look, ("diff", behavior, other, "--watch"))
    assert ran.code == 1
    assert [line.partition(" at ")[0] for line in ran.out.splitlines()[-2:]] == [
        "A, b.colony: watch",
        "B, other.colony: watch",
    ]


def test_without_a_run_there_is_no_page(colony: Colony, behavior: Path) -> None:
    behavior.write_text(behavior.read_text() + "contract fine: true\n")
    code, out, err = colony("verify", behavior, "--watch", "fine")
    assert (code, "watch at" in out) == (0, False)
    assert "no run to watch: none is known that breaks `fine`" in err
    assert colony("diff", behavior, behavior, "--watch").code == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("verify", "b.colony", "c.colony", "--watch", "x"), "--watch requires a single FILE"),
        (("verify", "b.colony", "--watch", "x", "--format", "json"), "--watch requires --format text"),
        (("verify", "b.colony", "--watch", "x", "--report", "r"), "leave out --contract, --why and --watch"),
        (("verify", "b.colony", "--open"), "--open and --port require --watch NAME"),
        (("verify", "b.colony", "--watch", "x"), "no contract `x`"),
        (("diff", "b.colony", "b.colony", "--port", "1"), "--open and --port require --watch"),
        (("diff", "b.colony", "b.colony", "--watch", "--format", "json"), "--watch requires --format text"),
    ],
)
def test_misuse(colony: Colony, behavior: Path, arguments: tuple[str, ...], message: str) -> None:
    (behavior.parent / "c.colony").write_text(behavior.read_text())
    assert message in colony.refusal(*arguments)
