"""A script that outlives failed calls."""

from __future__ import annotations

import threading
from contextlib import closing
from typing import cast

from colony.runtime.assembly.processes.restarted_script import RestartedScript
from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import ServerNotFoundError
from colony.runtime.kit.script import Script, do, sleep
from colony.runtime.library import data
from tests.waiting import PATIENCE_S


class Absent:
    """A session with a robot on which no server runs."""

    def connect(self, server: str, **options: object) -> None:
        raise ServerNotFoundError(f"no {server}")

    def time_ns(self) -> int:
        return 7


def test_a_script_begins_again_after_a_failed_call_and_ends_when_it_is_closed() -> None:
    begun, thrice = list[int](), threading.Event()

    def script() -> Script:
        begun.append((yield from sleep(0.0)))
        if len(begun) == 3:
            thrice.set()
            while True:
                yield from sleep(1000.0)
        yield from do("DServer", data.set("X", 1.0))

    with closing(RestartedScript(cast("Session", Absent()), script, name="test")) as running:
        assert thrice.wait(PATIENCE_S)
        running.close()
    assert begun == [7, 7, 7]
    assert not any(thread.name == "test" for thread in threading.enumerate())
