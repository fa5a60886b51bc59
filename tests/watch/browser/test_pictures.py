"""Pictures of the page at three sizes; the one of docs/watch.md is made here (`make browser`)."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.cli.machine import MAP, WANDER, Machine, failed
from tests.waiting import until
from tests.watch.browser.chromium import SIZES, Browser, needs_chromium

pytestmark = [pytest.mark.long, needs_chromium]

MOMENT_S = 35.9
"""A moment of the run in which the robot turns at a corner."""


def test_pictures_of_a_recording(browser: Browser, tmp_path: Path) -> None:
    machine = Machine(tmp_path / "machine", XDG_CACHE_HOME=str(tmp_path / "cache"))
    (tmp_path / "machine").mkdir()
    recording = tmp_path / "run.mcap"
    options = ("--map", MAP, "--seed", "1", "--duration", "60", "--no-picture", "--record", str(recording))
    ran = machine.run("run", WANDER, *options)
    assert ran.wait() == 0
    server = machine.start("watch", str(recording), "--map", MAP, "--port", "0")
    until(lambda: failed(server) or "http" in server.out, "the page is served")
    browser.open(server.out.split()[-1])
    end = "return document.querySelector('#timeline').getAttribute('aria-valuemax')"
    until(lambda: browser.run(end) == "60.0" or float(browser.run(end)) > 59, "the recording is read")
    browser.press(" ")
    browser.run("document.querySelector('#kinds').value = '1'")
    browser.press("\ue011", "n")
    until(lambda: "won" in browser.text("[data-module=cruise] .state"), "cruise commands")
    browser.press("n")
    until(lambda: "won" in browser.text("[data-module=avoid] .state"), "avoid commands")
    browser.run("document.querySelector('[data-module=keep_middle]').dispatchEvent(new MouseEvent('click'))")
    until(lambda: "frame" in browser.text("#reason-title"), "an answer comes")
    for size in SIZES:
        browser.resize(size)
        for scheme in ("light", "dark"):
            browser.prefer(scheme)
            browser.run(
                "return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
            )
            browser.picture(tmp_path / f"{size}-{scheme}.png")
            assert (tmp_path / f"{size}-{scheme}.png").stat().st_size > 20_000
    if kept := os.environ.get("WATCH_PICTURE"):
        Path(kept).write_bytes((tmp_path / "desktop-light.png").read_bytes())
    machine.close()
