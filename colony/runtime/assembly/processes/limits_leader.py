"""The thread that keeps the limits of a robot's description deployed, in the process of their clients."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread

from colony.execute.compiled import Compiled
from colony.runtime.assembly.limits import CALL_TIMEOUT_S, lead_limits
from colony.runtime.kit.connection import Session
from colony.runtime.kit.hub import Hub
from colony.runtime.kit.script_live import run_script
from colony.runtime.transport.live.host import Host


@contextmanager
def leading_limits(host: Host, compiled: Compiled) -> Iterator[None]:
    """Lead the limits inside the `with`. A failure stops the host, and is raised at the end.

    Raises:
        Exception: as raised by the script, which handles refusals and lost connections itself.
    """
    stop, failures = Event(), list[BaseException]()

    def lead() -> None:
        try:
            run_script(session, lead_limits(compiled), name="limits", stop=stop, timeout_s=CALL_TIMEOUT_S)
        except BaseException as failure:
            failures.append(failure)
            host.stop()

    with Session(Hub(host.network)) as session:
        thread = Thread(target=lead, name="limits", daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()
    if failures:
        raise failures[0]
