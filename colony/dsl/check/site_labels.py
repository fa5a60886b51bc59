"""Labels on the errors that a program has only because of the values that a site sets."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from colony.dsl.site import SiteParams
from colony.text.diagnostics import Diagnostic, Label

MAX_LABELS = 5
"""Maximum number of values that one error refers to."""


def with_site_labels(
    found: Sequence[Diagnostic], own: Sequence[Diagnostic], params: SiteParams
) -> tuple[Diagnostic, ...]:
    """Return findings with labels at the values behind those errors that the program has only with `params`.

    Args:
        found: the findings with the values of the site.
        own: the findings without them.
        params: the values.
    """
    before = {_identity(d) for d in own}
    return tuple(
        d
        if d.severity != "error" or _identity(d) in before or _is_about_site(d, params)
        else replace(d, labels=(*d.labels, *_labels(d, params)))
        for d in found
    )


def _identity(d: Diagnostic) -> tuple[object, ...]:
    return d.code, d.span.source.name, d.span.start, d.message


def _is_about_site(d: Diagnostic, params: SiteParams) -> bool:
    return any(d.span.source is value.key.source for value in params.values)


def _labels(d: Diagnostic, params: SiteParams) -> list[Label]:
    """Return labels at the values that the text of an error names, or at all if it names none."""
    words = set(re.findall(r"\w+", d.span.text))
    usable = [value for value in params.values if value.text is not None]
    named = [value for value in usable if value.name.rpartition(".")[2] in words]
    return [
        Label(value.place, f"the value of `{value.name}`, which stands in for the one in the program")
        for value in (named or usable)[:MAX_LABELS]
    ]
