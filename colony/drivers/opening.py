"""The opening dialogue of a device, step by step. Pure: packets and times are given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic

from colony.drivers.decoder import Packet
from colony.drivers.dialect import REFUSALS, Ask, Opening, Send


class OpeningRun(Generic[Packet]):
    """An opening that runs. Mutable: one step after the other. Each method raises what the dialogue raises.

    Args:
        opening: the dialogue.
        send: sends the bytes of a step.
        now_ns: the time; the first step begins.
    """

    def __init__(self, opening: Opening[Packet], send: Callable[[bytes], None], now_ns: int) -> None:
        self._opening = opening
        self._send = send
        self._step: Send | Ask[Packet] | None = None
        self._due_ns = 0
        self._go_on(None, now_ns)

    @property
    def is_done(self) -> bool:
        """True once the device is ready."""
        return self._step is None

    def on_packet(self, packet: Packet, now_ns: int) -> None:
        """Take a packet: the answer to a question, if it is accepted."""
        try:
            is_answer = isinstance(self._step, Ask) and self._step.accepts(packet)
        except REFUSALS:  # `accepts` cannot read the packet
            return
        if is_answer:
            self._go_on(packet, now_ns)

    def on_time(self, now_ns: int) -> None:
        """End a pause, or a question without an answer, that is over."""
        if self._step is not None and now_ns >= self._due_ns:
            self._go_on(None, now_ns)

    def _go_on(self, answer: Packet | None, now_ns: int) -> None:
        try:
            step = self._opening.send(answer)
        except StopIteration:
            self._step = None
            return
        if step.data:
            self._send(step.data)
        wait_s = step.timeout_s if isinstance(step, Ask) else step.pause_s
        self._step, self._due_ns = step, now_ns + round(wait_s * 1e9)
