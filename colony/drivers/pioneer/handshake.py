"""The handshake of Pioneer robots: SYNC0 to SYNC2, OPEN, the check of the model, the settings. Pure.

Source: Pioneer 3 operations manual; Player, for closing a session; AMRISim (docs/tried-with.md).
"""

from __future__ import annotations

from collections.abc import Generator

from colony.drivers.dialect import Ask, Opening, OpeningError, Send
from colony.drivers.pioneer.codec import Command, command
from colony.drivers.pioneer.parameters import parameters_of
from colony.drivers.pioneer.sip import MOVING, STOPPED, ConfigSip, Identity, may_drive, read_sip

SETTLE_S = 0.5
"""Time before the handshake, in which the stop of a new guard is repeated, and an open session is heard."""

CLOSE_S = 0.4
"""Pause after an older session was closed (Player)."""

ATTEMPTS = 5

CONFIG = 0x20


def handshake(model: str, baud: int, stop: bytes) -> Opening[bytes]:
    """Return the dialogue after which a session is open with a robot of this model, which stands.

    A session that is open already goes on after `stop`, if the robot gives its configuration.

    Raises:
        OpeningError: no robot answers, it is another model, or its watchdog is off.
    """
    config = None
    if (yield Ask(b"", is_standard, SETTLE_S)) is not None:
        config = yield from _configuration(stop)
        if config is None:
            yield Send(command(Command.CLOSE), CLOSE_S)
    if config is not None:
        _expect_model(config.identity, model)
    else:
        _expect_model((yield from _synchronized(baud)), model)
        if (yield Ask(command(Command.OPEN), is_standard)) is None:
            raise OpeningError("the robot answers, but sends no state: switch it off and on")
        config = yield from _configuration()
    if config is not None and config.watchdog_ms == 0:
        raise OpeningError("the robot's watchdog is off: set WatchDog to 2000 ms with ARCOScfg")


def set_up(settings: bytes) -> Opening[bytes]:
    """Return the dialogue that sends settings until the robot shows that its motors are on.

    Commands are not acknowledged, and may be lost on the line. It ends in any case: a pressed stop button
    keeps the motors off.
    """
    for _ in range(ATTEMPTS):
        if (yield Ask(settings, may_drive)) is not None:
            return


def is_standard(data: bytes) -> bool:
    """Return whether a packet is a standard one, which only open sessions send."""
    return data[0] in (STOPPED, MOVING)


def _synchronized(baud: int) -> Generator[Send | Ask[bytes], bytes | None, Identity]:
    """Return the identity of the robot, after SYNC0, SYNC1 and SYNC2; a wrong answer begins again."""
    for _ in range(ATTEMPTS):
        for number in (0, 1, 2):
            answer = yield Ask(command(number), _any)
            if answer is None or answer[0] != number:
                break
        if answer is not None and is_standard(answer):  # an older session is open
            yield Send(command(Command.CLOSE), CLOSE_S)
        elif answer is not None and isinstance(identity := read_sip(answer), Identity):
            return identity
    raise OpeningError(f"no Pioneer answers: is it switched on, its cable plugged in, its baud rate {baud}?")


def _configuration(before: bytes = b"") -> Generator[Send | Ask[bytes], bytes | None, ConfigSip | None]:
    """Return the configuration of an open session, asked for after `before`.

    It is None if none comes: some robots send it with a wrong checksum.
    """
    answer = yield Ask(before + command(Command.CONFIG, 1), lambda data: data[0] == CONFIG)
    config = None if answer is None else read_sip(answer)
    return config if isinstance(config, ConfigSip) else None


def _any(data: bytes) -> bool:
    return True


def _expect_model(identity: Identity, model: str) -> None:
    if identity.model.casefold() != model.casefold():
        known = " (no row of its model is known)" if parameters_of(identity.model) is None else ""
        raise OpeningError(
            f"the robot {identity.name} is a {identity.model}{known}, and the body says model = {model!r}"
        )
