"""Rates of messages, by sender, as token buckets.

A sender begins with `burst` tokens and gains `per_s` tokens a second, up to `burst`. A message costs one
token, and one more for each `BYTES_PER_TOKEN` of its size. A sender with too few tokens is over its rate.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from threading import Lock
from typing import NamedTuple

BYTES_PER_TOKEN = 16_384
"""Bytes of a message that cost one extra token."""

MAX_SENDERS = 1024
"""Maximum number of buckets. Beyond that, the bucket of the least recently active sender is dropped."""


class Rate(NamedTuple):
    """The tokens gained per second, and the maximum that a sender may accumulate."""

    per_s: float
    burst: float


@dataclass(frozen=False, slots=True)
class _Bucket:
    tokens: float
    updated_ns: int


class Meter:
    """A token bucket per sender. Mutable. Threads may share it."""

    def __init__(self, rate: Rate) -> None:
        self._per_ns = rate.per_s / 1e9
        self._burst = rate.burst
        self._buckets: OrderedDict[str, _Bucket] = OrderedDict()
        self._lock = Lock()

    def take(self, sender: str, size: int, now_ns: int, count: int = 1) -> bool:
        """Pay for `count` messages of `size` bytes in total; return False if the sender is over its rate.

        `now_ns` is a monotonic time.
        """
        cost = count + size // BYTES_PER_TOKEN
        with self._lock:
            bucket = self._bucket(sender, now_ns)
            if bucket.tokens < cost:
                return False
            bucket.tokens -= cost
            return True

    def _bucket(self, sender: str, now_ns: int) -> _Bucket:
        """Return a sender's bucket, refilled up to `now_ns`."""
        bucket = self._buckets.get(sender)
        if bucket is None:
            bucket = self._buckets[sender] = _Bucket(self._burst, now_ns)
            if len(self._buckets) > MAX_SENDERS:
                self._buckets.popitem(last=False)
        elif now_ns > bucket.updated_ns:
            self._buckets.move_to_end(sender)
            bucket.tokens = min(self._burst, bucket.tokens + (now_ns - bucket.updated_ns) * self._per_ns)
            bucket.updated_ns = now_ns
        return bucket
