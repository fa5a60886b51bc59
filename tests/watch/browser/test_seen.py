"""Pictures of cameras and the ellipse of the pose in a real browser, read from real servers."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.nav.pose.pose import PoseEstimate, pose_list
from colony.nav.shared import POSE
from colony.runtime.library import data
from colony.runtime.servers.cserver import CServer
from colony.runtime.servers.dserver import DServer
from colony.watch.asking import Asker, asking_robot, find_signs
from colony.watch.store import SnapshotStore
from colony.watch.watched import Watched
from tests.waiting import until
from tests.watch.browser.chromium import SIZES, Browser, needs_chromium
from tests.watch.runs import scene, served, snapshots
from tests.watch.test_pictures import PLATE, Still, image_of, robot

pytestmark = [pytest.mark.long, needs_chromium]

SHADES = (
    "const c = document.querySelector('#cameras canvas');"
    "return new Set(c.getContext('2d').getImageData(0, 0, c.width, c.height).data).size"
)


def test_pictures_are_shown_while_the_page_follows(browser: Browser, tmp_path: Path) -> None:
    store = SnapshotStore(scene().modules)
    for snapshot in snapshots():
        store.add(snapshot)
    with robot(CServer(Still(image_of(PLATE)), address="CServerSide")) as session:
        asker = Asker(lambda: asking_robot(session, find_signs))
        watched = Watched(scene=scene(), store=store, is_live=True, asker=asker)
        with served(watched) as server:
            browser.open(server.url)
            until(lambda: browser.text("#cameras figcaption") == "CServerSide: plate 376", "it is found")
            assert browser.run(SHADES) > 50
            for size in SIZES:
                browser.resize(size)
                picture = browser.run(
                    "const b = document.querySelector('#cameras canvas').getBoundingClientRect();"
                    "return [b.width, b.height]"
                )
                assert min(picture) > 50
                browser.picture(tmp_path / f"{size}.png")
            browser.press(" ")
            until(lambda: "looking back" in browser.text("#mode"), "it looks back")
            visibility = "return getComputedStyle(document.querySelector('#cameras canvas')).visibility"
            until(lambda: browser.run(visibility) == "hidden", "a picture of now is not shown then")
            assert browser.errors() == []
        asker.close()
    store.close()


MARKED = (
    "const style = getComputedStyle(document.documentElement).getPropertyValue('--warn').trim();"
    "const [r, g, b] = [1, 3, 5].map((i) => parseInt(style.slice(i, i + 2), 16));"
    "const c = document.querySelector('#map');"
    "const data = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; let n = 0;"
    "for (let i = 0; i < data.length; i += 4)"
    "  n += Math.abs(data[i] - r) + Math.abs(data[i + 1] - g) + Math.abs(data[i + 2] - b) < 30"
    "    && data[i + 3] > 200;"
    "return n"
)
"""Pixels of the map in the color of the ellipse."""


def test_the_ellipse_is_drawn_while_the_page_follows(browser: Browser, tmp_path: Path) -> None:
    store = SnapshotStore(scene().modules)
    for snapshot in snapshots():
        store.add(snapshot)
    with robot(DServer()) as session, session.connect("DServer") as variables:
        asker = Asker(lambda: asking_robot(session, find_signs))
        watched = Watched(scene=scene(), store=store, is_live=True, asker=asker)
        with served(watched) as server:
            browser.open(server.url)
            until(lambda: browser.text("#mode") == "live", "it is live")
            assert browser.run(MARKED) == 0
            pose = PoseEstimate(0, 1900.0, 0.0, 270.0, 90_000.0, 30_000.0, 0.0, 40_000.0, 0.0, 4.0)
            variables.do(data.set(POSE, pose_list(pose)))
            until(lambda: browser.run(MARKED) > 20, "the ellipse is drawn")
            browser.picture(tmp_path / "ellipse.png")
            browser.press(" ", "\ue012")  # pause; left: a frame back
            until(lambda: browser.run(MARKED) == 0, "an ellipse of now is not shown with the past")
        asker.close()
    store.close()
