"""Measures the page: `python -m tools.watch_page --seconds 600`.

Prints, of a program with 100 modules and a lidar of 360 beams, the first paint and the frames that headless
Chromium draws in a second; then, over some time at 20 Hz, how much memory the page and the server gain.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, Thread

import msgspec

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.ir.frame import Frame, Reading
from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from colony.watch.scene import scene_of
from colony.watch.sources import LiveSource
from colony.watch.store import SnapshotStore
from colony.watch.trail import RunTrail
from colony.watch.watched import Watched
from tests.analysis.recorded_runs import logs
from tests.watch.browser.chromium import Browser, chromium
from tests.watch.runs import served

MODULES, BEAMS = 100, 360


def program(frame_ms: int) -> Program:
    """Return a program in which another module wins every few frames."""
    modules = "\n".join(
        f"module m{i} {{ when scan[{i * 3 - 180} deg] < 1.5 m do drive(velocity = {i} mm/s, turn = 0) }}"
        for i in range(MODULES)
    )
    chain = " suppresses ".join(f"m{i}" for i in range(MODULES))
    return load_text(f"""
robot big {{
  frame {frame_ms} ms
  sensor scan[{BEAMS}] : m bearing -180 deg step 1 deg range 0 .. 12 from Lidar.scan
  sensor x : mm from RServer.x
  sensor y : mm from RServer.y
  sensor heading : deg from RServer.heading
  actuator drive {{ velocity : mm/s range -400 .. 400, turn : deg/s }}
           to RServer.drive idle drive(velocity = 0, turn = 0)
}}
{modules}
network {{ drive = {chain} }}
""")


def frame(k: int, frame_ms: int) -> Frame:
    """Return a frame in which an obstacle goes around the robot."""
    scan = tuple(round(4 + 3 * math.sin((i + 7 * k) * 0.03), 4) for i in range(BEAMS))
    readings: dict[str, Reading] = {
        "scan": scan,
        "x": 1000.0 * math.sin(k / 90),
        "y": 10.0 * k % 9000,
        "heading": k % 360.0,
    }
    return Frame(k * frame_ms * 1_000_000, readings)


def run_of(of: Program, frames: int, frame_ms: int) -> list[RunFrame]:
    """Return a run."""
    return logs(of, [frame(k, frame_ms) for k in range(frames)])


def heap(browser: Browser) -> float:
    """Return the page's heap after a collection, in MB."""
    browser.driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
    browser.driver.execute_cdp_cmd("Performance.enable", {})
    metrics = browser.driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
    return float(next(m["value"] for m in metrics if m["name"] == "JSHeapUsedSize")) / 1e6


def resident() -> float:
    """Return the resident memory of this process, the server, in MB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE") / 1e6


def cpu_s(browser: Browser) -> float:
    """Return the processor time that the browser's processes have used, in seconds."""
    times: dict[int, tuple[int, float]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            fields = path.read_text().rpartition(")")[2].split()
            used = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
            times[int(path.parent.name)] = int(fields[1]), used
    tree, total = {browser.driver.service.process.pid}, 0.0
    while found := {pid for pid, (parent, _) in times.items() if parent in tree} - tree:
        tree |= found
    for pid in tree:
        total += times.get(pid, (0, 0.0))[1]
    return total


def drawn(browser: Browser) -> int:
    return int(browser.run("return colonyWatch.drawn"))


def measure(seconds: float, folder: Path, picture: Path | None) -> None:
    """Measure, and print."""
    frame_ms = 50
    of = program(frame_ms)
    frames = run_of(of, 400, frame_ms)
    scene = scene_of(of, "measured", compile_program(of).compiled.clients)
    store, trail = SnapshotStore(scene.modules, max_bytes=64 * 1024 * 1024), RunTrail(of)
    source = LiveSource(of, store, trail)
    for log in frames:
        source.put(log)
        while store.span.end < log.tick.k - 50:
            time.sleep(0.01)
    while store.span.end < len(frames) and store.problem is None:
        time.sleep(0.1)
    watched = Watched(scene=scene, store=store, is_live=True, explain=trail.explain)
    with served(watched) as server, chromium(folder) as browser:
        browser.resize("desktop")
        browser.open(server.url)
        time.sleep(2)
        paints = browser.run("return performance.getEntriesByType('paint').map((p) => p.startTime)")
        print(f"first paint: {max(paints):.0f} ms")
        browser.run("document.querySelector('#speed').value = '2'")
        browser.press("\ue011")
        browser.run("document.querySelector('#speed').dispatchEvent(new Event('change'))")
        time.sleep(0.5)
        before, began, used = drawn(browser), time.monotonic(), cpu_s(browser)
        time.sleep(12)
        frames_drawn = drawn(browser) - before
        print(f"frames drawn: {frames_drawn / (time.monotonic() - began):.1f} per second", flush=True)
        print(
            f"time of all cores per frame drawn: {(cpu_s(browser) - used) / frames_drawn * 1e3:.1f} ms",
            flush=True,
        )
        if picture is not None:
            browser.picture(picture)
        browser.click("#follow")
        _memory(browser, source, frames, seconds)
    source.close()
    store.close()


def _memory(browser: Browser, source: LiveSource, frames: list[RunFrame], seconds: float) -> None:
    ended = Event()
    last = frames[-1]

    def feed() -> None:
        k, begin = last.tick.k, time.monotonic()
        while not ended.wait(max(0.0, begin + (k - last.tick.k) * 0.05 - time.monotonic())):
            k += 1
            log = frames[k % len(frames)]
            tick = msgspec.structs.replace(log.tick, k=k, t_ns=k * 50_000_000)
            source.put(replace(log, tick=tick, frame=log.frame._replace(t_ns=k * 50_000_000), keyframe=None))

    thread = Thread(target=feed)
    thread.start()
    time.sleep(min(60.0, seconds / 4))
    rows = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        rows.append((heap(browser), resident()))
        time.sleep(seconds / 10)
    ended.set()
    thread.join()
    print("page, MB:", *(f"{page:.1f}" for page, _ in rows))
    print("server, MB:", *(f"{server:.1f}" for _, server in rows))


def main() -> None:
    """Run as a script."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--picture", type=Path)
    chosen = parser.parse_args()
    with TemporaryDirectory() as folder:
        measure(chosen.seconds, Path(folder), chosen.picture)


if __name__ == "__main__":
    main()
