"""A robot that runs, in a real browser: live, stopped in an emergency, and after the page's server died."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from tests.cli.machine import MAP, ROBOT, WANDER, Machine, failed, release
from tests.paths import ROOT
from tests.waiting import until
from tests.watch.browser.chromium import Browser, needs_chromium

pytestmark = [pytest.mark.long, needs_chromium]

FOLLOW_WALL = str(ROOT / "behaviors" / "follow_wall.colony")


@pytest.fixture
def machine(tmp_path: Path) -> Machine:  # type: ignore[misc]
    machine = Machine(tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"))
    yield machine
    machine.close()


def frame(browser: Browser) -> int:
    return int((browser.text("#clock").split() or ["-1"])[-1])


def test_live_stopped_and_reconnected(machine: Machine, browser: Browser) -> None:
    run = machine.start("run", WANDER, "--map", MAP, "--processes", "--no-picture", "--duration", "1000")
    until(lambda: run.ended() or machine.moves(), "the robot drives")
    arguments = ("watch", "--robot", ROBOT, "--map", MAP, "--allow-stop", "--port")
    server = machine.start(*arguments, "0")
    until(lambda: failed(server) or "http" in server.out, "the page is served")
    url = server.out.split()[-1]
    browser.open(url)
    until(lambda: browser.text("#mode") == "live", f"it is live: {browser.text('#mode')}")
    first = until(lambda: frame(browser), "a frame is shown")
    until(lambda: frame(browser) > first + 5, "frames go on")
    until(lambda: "won" in browser.text("#network .module.won .state"), "a module commands")

    browser.click("#stop")
    until(lambda: "acknowledged by" in browser.text("#message"), "the stop is acknowledged")
    until(machine.stands, "the robot stands")
    until(lambda: browser.text("#mode").startswith("STOPPED"), "the page says so")
    until(lambda: browser.text(".command small") == "emergency stop", "the command is held")

    server.process.kill()
    server.process.wait()
    until(lambda: browser.text("#mode") == "no connection", "the page notices")
    port = url.split(":")[2].split("/")[0]
    again = machine.start(*arguments, port)
    until(lambda: failed(again) or browser.text("#mode").startswith("STOPPED"), "the page is back")
    with machine.session() as session:
        release(session)
    until(machine.moves, "the robot drives on")
    until(lambda: browser.text("#mode") == "live", "it is live again")
    live_wires = "return document.querySelectorAll('.wire.live').length"
    until(lambda: browser.run(live_wires) > 0, "a command reaches the base")
    again.tell(signal.SIGTERM)
    assert again.wait() == 0
    assert not run.ended()


def test_the_page_follows_the_robot_into_its_next_run(machine: Machine, browser: Browser) -> None:
    drive = ("--map", MAP, "--processes", "--no-picture", "--duration", "1000")
    run = machine.start("run", WANDER, *drive)
    until(lambda: run.ended() or machine.moves(), "the robot drives")
    server = machine.start("watch", "--robot", ROBOT, "--port", "0")
    until(lambda: server.ended() or "http" in server.out, "the page is served")
    browser.open(server.out.split()[-1])
    until(lambda: browser.text("#mode") == "live", f"it is live: {browser.text('#mode')}")
    first = browser.text("#title")
    run.interrupt()
    until(lambda: browser.text("#mode").startswith("no frames come"), "the page notices that it has ended")
    machine.start("run", FOLLOW_WALL, *drive)
    until(lambda: browser.text("#title") != first, "the page shows the next run")
    until(lambda: browser.text("#mode") == "live", "it is live")
    assert browser.run("return document.querySelectorAll('[data-module=follow]').length")
    assert not server.ended()


TUNABLE = """language 1
import robot
tunable param roaming = 0.1 m/s in 0 m/s .. 0.5 m/s
module roam { when true do drive(velocity = roaming, turn = 0) }
network { drive = roam }
"""


def test_a_slider_changes_a_tunable_param(machine: Machine, browser: Browser, tmp_path: Path) -> None:
    behavior = tmp_path / "roam.colony"
    behavior.write_text(TUNABLE)
    drive = ("--robot", "rome", "--map", MAP, "--processes", "--no-picture", "--duration", "1000")
    run = machine.start("run", str(behavior), *drive)
    until(lambda: run.ended() or machine.moves(), "the robot drives")
    for options, is_free in (((), False), (("--allow-tuning",), True)):
        server = machine.start("watch", "--robot", ROBOT, "--port", "0", *options)
        until(lambda server=server: failed(server) or "http" in server.out, "the page is served")
        browser.open(server.out.split()[-1])
        until(lambda: browser.text(".strip input + output") == "0.100 m/s", "its value is shown")
        assert browser.run("return document.querySelector('.strip input').disabled") is not is_free
    browser.click(".strip input")  # in the middle
    until(lambda: browser.text("#message").startswith("roaming is in force from frame "), "it is in force")
    until(lambda: browser.text(".strip input + output") == "0.250 m/s", "frames have the value")
    until(lambda: (truth := machine.truth()) is not None and truth.velocity > 200.0, "the robot is faster")


def test_the_page_says_that_no_program_runs_until_one_does(machine: Machine, browser: Browser) -> None:
    servers = machine.start("serve", "all", "--robot", ROBOT, "--map", MAP)
    until(lambda: servers.ended() or machine.stands(), "the robot is there")
    server = machine.start("watch", "--robot", ROBOT, "--map", MAP, "--port", "0")
    until(lambda: server.ended() or "http" in server.out, "the page is served")
    browser.open(server.out.split()[-1])
    until(lambda: browser.text("#title") == "no program runs", "the page says so")
    assert browser.text("#reason-title") == "No program runs"
    assert browser.run("return document.querySelector('#network').hidden")
    until(lambda: browser.text("#mode") == "live", "it is live")
    until(lambda: "nearest" in browser.text("#polars"), "the sonars are shown")
    run = machine.start("drive", WANDER, "--robot", ROBOT)
    until(lambda: browser.text("#title").startswith("run "), "the page shows the run")
    until(lambda: "won" in browser.text("#network .module.won .state"), "a module commands")
    assert not browser.run("return document.querySelector('#network').hidden")
    run.interrupt()
    until(lambda: browser.text("#title").startswith("no program runs"), "the page shows the robot alone")
    until(lambda: browser.text("#mode") == "live", "it is live")
    assert browser.errors() == []


def test_a_run_shows_itself_and_one_looks_back(machine: Machine, browser: Browser) -> None:
    run = machine.start("run", WANDER, "--map", MAP, "--watch", "--no-picture", "--duration", "1000")
    until(lambda: failed(run) or "watch at" in run.err, "the page is served")
    browser.open(run.err.partition("watch at ")[2].split()[0])
    until(lambda: frame(browser) > 10, "frames are shown")
    browser.press("\ue011")  # Home
    until(lambda: "looking back" in browser.text("#mode"), "it looks back")
    assert browser.run("return document.querySelector('#stop').hidden")
    browser.click("#follow")
    until(lambda: browser.text("#mode") == "live", "it is live again")
    assert run.interrupt() == 130
