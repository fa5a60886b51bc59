"""The versions of the language and of its meaning.

The *language* version says which texts there are, the *semantics* version what they decide. They are separate
from the versions of file formats, which say how recordings and compiled programs are laid out.
"""

LANGUAGE = 1
"""Version of the language, as in the line `language 1` of a file."""

SEMANTICS = 4
"""Version of what programs mean: increment it if some program may decide differently than before.

Recordings, compiled programs and JSON output contain it. A recording or compiled program of another version
is refused, because its decisions cannot be repeated or continued.
"""


def semantics_mismatch(found: object) -> str:
    """Return the predicate of a message about a recording or compiled program of another version."""
    return f"is of version {str(found)[:20]} of the semantics; this is version {SEMANTICS}"
