"""What benchmarks are told on their command lines."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path


def whole_number(what: str, least: int) -> Callable[[str], int]:
    """How an argument is read that is a whole number, `least` or more, for argparse."""

    def read(text: str) -> int:
        if not (text.isascii() and text.isdigit()) or int(text) < least:
            raise argparse.ArgumentTypeError(
                f"`{text}` is no {what}; expected a whole number from {least} on"
            )
        return int(text)

    return read


def picture(text: str) -> Path:
    """A file that a picture is drawn into, for argparse."""
    path = Path(text)
    if path.suffix.lower() not in (".png", ".svg") or not path.absolute().parent.is_dir():
        expected = "expected a file ending in .png or .svg, in a folder that exists"
        raise argparse.ArgumentTypeError(f"cannot draw into `{text}`; {expected}")
    return path
