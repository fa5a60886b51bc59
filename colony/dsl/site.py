"""The params of a site as data: what `site_reading` reads, and the checker puts into a program."""

from __future__ import annotations

from colony.record import Record, record
from colony.text.diagnostics import Diagnostic
from colony.text.source import Span


@record
class SiteValue(Record):
    """A value for a param.

    Attributes:
        name: the name of the param as written.
        text: the value as the language writes it; None for one that was reported.
        is_text: True if it was given as a text, False for a number or bool.
        key: the place of the name.
        place: the place of the value.
    """

    name: str
    text: str | None
    is_text: bool
    key: Span
    place: Span


@record
class SiteParams(Record):
    """The values that a site sets, and the errors that were found in reading them."""

    file: str
    values: tuple[SiteValue, ...]
    diagnostics: tuple[Diagnostic, ...] = ()

    def only(self, names: frozenset[str]) -> SiteParams:
        """Return the same with the values of these names alone."""
        kept = tuple(value for value in self.values if value.name in names)
        return SiteParams(file=self.file, values=kept, diagnostics=self.diagnostics)
