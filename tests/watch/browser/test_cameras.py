"""The pictures of a robot's cameras in a real browser, read from a real camera server."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.runtime.servers.cserver import CServer
from colony.watch.asking import Asker, asking_cameras
from colony.watch.pictures import find_signs
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
        asker = Asker(lambda: asking_cameras(session, find_signs))
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
