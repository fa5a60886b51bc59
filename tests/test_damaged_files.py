"""Damaged maps, bodies, programs and settings: no exception but the reader's own, and no long wait.

`python -m tests.test_damaged_files COUNT [KIND ...]` damages that many files of each kind.
"""

from __future__ import annotations

import io
import random
import re
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from PIL import Image

from colony.body.reader import body_of_text
from colony.dsl.descriptions import find_project
from colony.dsl.load import check_text
from colony.dsl.site_reading import params_from_toml
from colony.nav.maps.building import load_building
from colony.nav.maps.world_map import load_world
from colony.runtime.transport.live.run_directory import SecurityError
from colony.runtime.transport.live.security import read_credentials, read_security
from colony.text.diagnostics import Diagnostic, DiagnosticError, has_errors, render
from colony.text.source import Source
from tests.body.test_reader import LIDAR, SMALL
from tests.dsl.test_fuzz import GOOD
from tests.nav.maps.grid.small_grids import yaml_of
from tests.paths import MAPS, ROBOTS

SLOW_S = 2.0
"""Seconds of the processor above which `main` reports a file."""

WITH_PARAMS = """
robot r { sensor s : m from P.s  actuator a { v : mm/s } to P.a idle a(v = 0) }
enum goal { none = 0, light = 76 }
param far = 3 m
param share = 20 percent
param on = true
param at = goal.light
module avoid { param clearance = 600 mm  when s < clearance do a(v = 0) }
network { a = avoid }
"""

WORDS = (
    *(b"0", b"-1", b"1e308", b"-1e308", b"nan", b"inf", b"9" * 30, b"0.1e-320", b"1_000", b"0x7f", b"65536"),
    *(b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\r", b"\r\n\r\n", *(c.encode() for c in "\u2212\u00a0\u00b5")),
    *(b"#", b'"', b"'''", b"[", b"]", b"[" * 200, b"{" * 200, b"(" * 200, b".", b"=", b":", b"&a *a "),
    *(
        b"true",
        b"robot",
        b"../../x",
        b"deg",
        b"mm/s^2",
        b"1979-05-27T07:32:00Z",
        b"- - -",
        b"P5\n",
        b"%s" * 9,
    ),
    *(b"a." * 9000 + b"a = 1\n", b"b = " + b"9" * 5000 + b"\n"),
)


def damaged(good: bytes, draws: random.Random) -> bytes:
    """Return a text or image with one to four damages."""
    for _ in range(draws.choice((1, 1, 2, 3, 4))):
        a, b = sorted(draws.randrange(len(good) + 1) for _ in range(2))
        b = min(b, a + draws.choice((1, 3, 20, 200)))
        tokens = [found.span() for found in re.finditer(rb"[\w.+-]+", good)] or [(0, 0)]
        match draws.randrange(10):
            case 0:
                good = good[:a] + good[b:]
            case 1:
                good = good[:b] + good[a:b] * draws.choice((1, 1, 2, 50)) + good[b:]
            case 2:
                good = good[:a] + draws.choice(WORDS) + good[b:]
            case 3:
                good = good[:a] + draws.choice(WORDS) + good[a:]
            case 4:
                good = good[:a] + bytes(draws.randrange(256) for _ in range(b - a)) + good[b:]
            case 5:
                lines = good.splitlines(keepends=True) or [b""]
                lines.insert(draws.randrange(len(lines) + 1), lines.pop(draws.randrange(len(lines))))
                good = b"".join(lines)
            case 6:
                good = good[:a]
            case _:
                (a, b), (c, d) = draws.choice(tokens), draws.choice(tokens)
                good = good[:a] + draws.choice((good[c:d], good[c:d], draws.choice(WORDS))) + good[b:]
    return good


def rendered(diagnostics: tuple[Diagnostic, ...]) -> bool:
    """Render findings; return True if there is an error."""
    for finding in diagnostics:
        assert render(finding)
    return has_errors(diagnostics)


def is_refused(load: Callable[[], object]) -> bool:
    try:
        load()
    except DiagnosticError as failure:
        return rendered(failure.diagnostics)
    except SecurityError:
        return True
    return False


def grid(path: Path) -> bool:
    def load() -> None:
        world = load_world(path)
        with suppress(ValueError):  # there is no room
            world.remarks(100.0, world.start(100.0))

    return is_refused(load)


def grid_image(path: Path) -> bool:
    keys = path.with_name("map.yaml")
    keys.write_text(yaml_of(image=path.name))
    return grid(keys)


def stickrep(path: Path) -> bool:
    return is_refused(lambda: load_building(path))


def body(path: Path) -> bool:
    found = body_of_text(text_of(path), path.name)
    assert (found.body is None) == bool(rendered(found.diagnostics))
    return found.body is None


def program(path: Path) -> bool:
    checked = check_text(text_of(path))
    assert (checked.program is None) == rendered(checked.diagnostics)
    return checked.program is None


def site(path: Path) -> bool:
    params = params_from_toml(Source(path.name, text_of(path)))
    return rendered(check_text(WITH_PARAMS, params=params).diagnostics)


def users(path: Path) -> bool:
    return is_refused(lambda: read_security(path)) and is_refused(lambda: read_credentials(path))


def project(path: Path) -> bool:
    found = find_project(path.parent)
    return found.problem is not None


def text_of(path: Path) -> str:
    return path.read_bytes().decode(errors="replace")


def gray_map(format_: str, mode: str) -> bytes:
    shades = np.full((40, 50), 254, dtype=np.uint8)
    shades[:, 20] = shades[0] = 0
    shades[30:] = 205
    with io.BytesIO() as file:
        Image.fromarray(shades).convert(mode).save(file, format_)
        return file.getvalue()


GOODS: dict[str, list[bytes]] = {
    "grid": [yaml_of(docks="[[0.1, 0.2, 0.3]]", mode="scale").encode(), yaml_of().encode()],
    "image": [
        *(gray_map(format_, mode) for format_ in ("PPM", "PNG", "BMP") for mode in ("L", "1", "RGB")),
        *(gray_map("PNG", mode) for mode in ("P", "LA")),
        b"P2\r\n# x\r\n3 2\r\n255\r\n0 0 0 205 254 254\r\n",
        b"P6 2 1 65535\n" + bytes(12),
    ],
    "stickrep": [(MAPS / f"{name}.stickrep").read_bytes() for name in ("loop", "narrow")],
    "body": [(SMALL + LIDAR).encode(), *(path.with_suffix(".toml").read_bytes() for path in ROBOTS)],
    "program": [GOOD.encode()],
    "site": [
        b'far = "2 m"\non = false\nshare = "3 percent"\nat = "goal.none"\n["avoid"]\nclearance = "90 mm"\n'
    ],
    "users": [
        b'[gateway]\ncertificate = "c.pem"\nkey = "k.pem"\nauthority = "a.pem"\n'
        b'[users.ada]\nmay = ["read", "command"]\n[users.guard]\nmay = ["stop"]\n'
    ],
    "project": [b'robot = "rome"\n[tool.x]\ny = [1, 2.5, 1979-05-27]\n'],
}

KINDS: dict[str, tuple[str, Callable[[Path], bool]]] = {
    "grid": ("map.yaml", grid),
    "image": ("map.image", grid_image),
    "stickrep": ("map.stickrep", stickrep),
    "body": ("small.toml", body),
    "program": ("go.colony", program),
    "site": ("site.toml", site),
    "users": ("users.toml", users),
    "project": ("colony.toml", project),
}


def run(kind: str, count: int, folder: Path) -> Counter[str]:
    """Damage files of a kind; return how many were refused, accepted, raised something, or took long."""
    (name, is_bad), found = KINDS[kind], Counter[str]()
    (folder / "map.png").write_bytes(gray_map("PNG", "L"))
    for number in range(count):
        draws = random.Random(f"{kind} {number}")
        data = damaged(draws.choice(GOODS[kind]), draws)
        (folder / name).write_bytes(data)
        began = time.process_time()
        try:
            found["refused" if is_bad(folder / name) else "accepted"] += 1
        except Exception:
            found["RAISED"] += 1
            print(f"{kind} {number}: {data[:300]!r}\n{traceback.format_exc(limit=-4)}", file=sys.stderr)
        if (took := time.process_time() - began) > SLOW_S:
            found["SLOW"] += 1
            print(f"{kind} {number}: {took:.1f} s: {data[:300]!r}", file=sys.stderr)
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_raise_nothing(kind: str, tmp_path: Path) -> None:
    found = run(kind, 25, tmp_path)
    assert found["refused"] > 5
    assert not found["RAISED"]


def main(count: str, *kinds: str) -> None:
    for kind in kinds or KINDS:
        with TemporaryDirectory() as folder:
            print(kind, dict(run(kind, int(count), Path(folder))), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
