"""The image of an occupancy grid, as shades and opacities of its cells."""

from __future__ import annotations

import io
import os
import re
import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from colony.files import read_file, reason
from colony.text.diagnostics import DiagnosticError, error
from colony.text.source import Span
from colony.text.wording import printable

if TYPE_CHECKING:
    from PIL.Image import Image

MAX_IMAGE_BYTES = 64 << 20
MAX_CELLS = 16_000_000
FORMATS = {"PPM": "PGM", "PNG": "PNG", "BMP": "BMP"}
"""The formats of images, by their names in Pillow: those that map_saver recommends."""

_OPAQUE = 255

_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_HEADER = re.compile(rb"(?:(P4)|(P[56]))%b(\d{1,9})%b(\d{1,9})(?(2)%b(\d{1,5}))" % (_GAP, _GAP, _GAP))
_REMARK = re.compile(rb"[ \t]*#[^\r\n]*")
_MAX_HEADER_BYTES = 1 << 16


class Shades(NamedTuple):
    """An image: rows from the top, shades from 0, black, to 255, white; True for cells that are opaque."""

    shade: NDArray[np.uint8]
    is_opaque: NDArray[np.bool_] | None


def load_image(path: str | os.PathLike[str], named: Span) -> Shades:
    """Load the image at `path`; `named` is the place that names it.

    Images of 16 bits are rounded to 8, and colors are replaced by their luma.

    Raises:
        DiagnosticError: the file cannot be read, is no image, is damaged or too large.
    """
    shown = printable(os.fspath(path))
    try:
        data = read_file(path, MAX_IMAGE_BYTES)
    except OSError as failure:
        raise _failure(named, f"cannot read the image `{shown}`: {reason(failure)}") from None
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the limit here is lower
            image = Image.open(io.BytesIO(_plain_header(data)), formats=list(FORMATS))
    except UnidentifiedImageError:
        raise _unknown(named, shown) from None
    except Image.DecompressionBombError:
        raise _too_large(named, "too many cells") from None
    except Exception:  # decoders raise exceptions of many kinds, with texts for programmers
        raise _damaged(named, shown, "its header is malformed or cut off") from None
    columns, rows = image.size
    if columns * rows > MAX_CELLS:
        raise _too_large(named, f"{columns} x {rows} cells")
    if image.mode == "F":  # a PFM, which Pillow takes for a kind of PGM
        raise _unknown(named, shown)
    try:
        return _shades(image)
    except Exception:  # as above
        raise _damaged(named, shown, "its cells are malformed or cut off") from None


def _plain_header(data: bytes) -> bytes:
    """Return a binary PBM, PGM or PPM with line feeds and no comments in its header; other data unchanged.

    By the format, and for Pillow, one byte ends the header. Programs end it with CR LF or a comment, too: the
    longest end is taken after which there are enough bytes for the cells.
    """
    header = _HEADER.match(data, 0, _MAX_HEADER_BYTES)
    if header is None:
        return data
    bitmap, other, columns, rows, maximum = header.groups()
    magic = bitmap or other
    bits = 1 if magic == b"P4" else (8 if int(maximum) < 256 else 16) * (3 if magic == b"P6" else 1)
    size = int(rows) * ((int(columns) * bits + 7) // 8)
    ends = _ends(data[: header.end() + _MAX_HEADER_BYTES], header.end())
    start = max((end for end in ends if len(data) - end >= size), default=None)
    if start is None:
        return data
    words = [magic, columns, rows, *([] if maximum is None else [maximum])]
    return b"\n".join([*words, data[start:]])


def _ends(data: bytes, at: int) -> Iterator[int]:
    """Yield the places where a header can end whose last word ends at `at`."""
    waiting = [at]
    while waiting:
        at = waiting.pop()
        remark = _REMARK.match(data, at)
        at = at if remark is None else remark.end()
        for length in {2 if data.startswith(b"\r\n", at) else 1, 1}:
            if data[at : at + 1].isspace():
                yield at + length
                waiting += [at + length] if data.startswith(b"#", at + length) else []


def _shades(image: Image) -> Shades:
    is_opaque = None
    if image.has_transparency_data:
        colors = image.convert("RGBA")
        is_opaque = np.asarray(colors.getchannel("A")) == _OPAQUE
        image = colors.convert("RGB")
    if image.mode.startswith("I"):
        return Shades(np.rint(np.asarray(image).astype(np.float64) / 257.0).astype(np.uint8), is_opaque)
    return Shades(np.asarray(image.convert("L")), is_opaque)


def _unknown(named: Span, shown: str) -> DiagnosticError:
    return _failure(named, f"`{shown}` is no image of a map; expected {' or '.join(FORMATS.values())}")


def _damaged(named: Span, shown: str, what: str) -> DiagnosticError:
    return _failure(named, f"the image `{shown}` is damaged: {what}")


def _too_large(named: Span, found: str) -> DiagnosticError:
    message = f"the image has {found}; expected at most {MAX_CELLS:,} of them"
    return DiagnosticError([error("M023", named, message)])


def _failure(named: Span, message: str) -> DiagnosticError:
    hint = "the path counts from the folder of the map" if "No such file" in message else None
    return DiagnosticError([error("M036", named, message, hint)])
