"""The packets between a guard and the drivers of its port: a kind of one byte, and a body.

A connection that commands has a channel for each actuator, from 0: its number is the first byte of `HELLO`,
`DECIDED` and `ASK`.
"""

import struct

HELLO = b"H"
"""From a driver that commands: the head, the stop, the goodbye of a channel."""

HELLO_HEAD = struct.Struct("<BI?H")
"""Head of a hello: channel, deadline in ms, whether the handshake precedes any stop, length of the stop."""

DECIDED = b"D"
"""From the driver that commands: the head, bytes that carry a decision out."""

DECIDED_HEAD = struct.Struct("<BQ")
"""Head of a decision: channel, and its time (CLOCK_MONOTONIC, ns)."""

ASK = b"A"
"""From the driver that commands: stop, if it says so, and answer once the newest stop or decision is sent."""

ASK_BODY = struct.Struct("<BI?")
"""Body of a question: channel, number of the question, and whether to stop."""

SENT = b"S"
"""To the driver that commands: u32 number of the question; empty, or why nothing was sent, as text."""

PLAIN = b"P"
"""From any driver: bytes of a handshake, a setting or a query, which keep no base moving."""

DATA = b"B"
"""To all drivers: u64 time of arrival (CLOCK_MONOTONIC, ns), bytes from the port."""

UP = b"U"
"""To all drivers: the port is open, and its device may have restarted; the baud rate as text."""

LOST = b"L"
"""To all drivers: why the port is not open, as text."""

REFUSED = b"R"
"""To a driver: why its connection is closed, as text."""

MAX_PACKET_BYTES = 65_536
