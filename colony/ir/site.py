"""The params of a site: values that a site sets in place of those in the program's text.

The program, its compiled form and recordings of its runs hold them.
"""

from __future__ import annotations

import json
from dataclasses import replace
from hashlib import sha256

from colony.record import Record, record


@record
class Site(Record):
    """The params that a site sets.

    Attributes:
        file: the name of the file that sets them, for messages.
        values: the full name of each param, in alphabetical order, with its value as the language writes it.
        proved: the contracts that were proved with these values, if every contract that is proved of the
            program without them still is; None if that was not proved.
    """

    file: str
    values: tuple[tuple[str, str], ...]
    proved: tuple[str, ...] | None = None

    @property
    def hash(self) -> str:
        """The SHA-256 of the values, in hexadecimal."""
        return sha256(json.dumps(self.values).encode()).hexdigest()

    def with_proof(self, contracts: tuple[str, ...]) -> Site:
        """Return the same values with the contracts that were proved with them."""
        return replace(self, proved=contracts)
