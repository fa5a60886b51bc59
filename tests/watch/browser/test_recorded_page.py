"""A recording in a real browser: what the page shows, by mouse, by keyboard, and for assistive tools."""

from __future__ import annotations

import http.server
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from websockets.sync.server import ServerConnection, serve
from websockets.typing import Subprotocol

from colony.watch.serving import PROTOCOL, PageServer, page_link
from colony.watch.watched import StopAnswer
from tests.waiting import until
from tests.watch.browser.chromium import AXE, SIZES, Browser, needs_chromium
from tests.watch.runs import FRAMES, TOKEN, recorded, served

pytestmark = [pytest.mark.long, needs_chromium]

ENTER, SPACE, LEFT, RIGHT, HOME = "\ue007", " ", "\ue012", "\ue014", "\ue011"


@pytest.fixture(scope="module")
def server() -> Iterator[PageServer]:
    with recorded() as watched, served(watched) as server:
        yield server


def shown(browser: Browser, server: PageServer) -> Browser:
    browser.open(server.url)
    until(lambda: "frame" in browser.text("#clock"), "a frame is shown")
    return browser


def paused(browser: Browser, server: PageServer) -> Browser:
    """Show the first frame, and stay there."""
    shown(browser, server)
    if browser.run("return document.querySelector('#play').ariaLabel") == "pause":
        browser.press(SPACE)
        until(lambda: browser.run("return document.querySelector('#play').ariaLabel") == "play", "it rests")
    browser.press(HOME)
    at_frame(browser, 0)
    return browser


def state(browser: Browser, module: str) -> str:
    return browser.text(f"[data-module={module}] .state")


def at_frame(browser: Browser, k: int) -> None:
    until(lambda: browser.text("#clock").endswith(f"frame {k}"), f"frame {k}, now {browser.text('#clock')}")


def test_it_shows_the_run_and_jumps_to_what_happened(browser: Browser, server: PageServer) -> None:
    paused(browser, server)
    browser.run("document.querySelector('#kinds').value = '2'")
    browser.press("n")
    at_frame(browser, 15)
    assert state(browser, "back_off") == "won"
    assert browser.text("#contracts .broken") == "✕never_backward"
    assert "back_off" in browser.text(".command h3")
    assert browser.run("return document.querySelectorAll('.wire.live').length") == 2
    browser.run("document.querySelector('#kinds').value = '8'")
    browser.press("p")
    at_frame(browser, 8)
    assert browser.text("#alarms") == "drive/cruise late"
    assert browser.errors() == []


def test_a_module_says_why_not(browser: Browser, server: PageServer) -> None:
    paused(browser, server)
    browser.run("document.querySelector('#kinds').value = '1'")
    browser.press("n")
    at_frame(browser, 3)
    browser.run("document.querySelector('[data-module=cruise]').focus()")
    browser.press(ENTER)
    until(lambda: "frame 3" in browser.text("#reason-title"), "an answer comes")
    assert "avoid" in browser.text("#reason-text")
    browser.run("document.activeElement.blur()")
    browser.press(RIGHT)
    until(lambda: "frame 4" in browser.text("#reason-title"), "the next frame is asked for")


def test_the_keyboard_alone_is_enough(browser: Browser, server: PageServer) -> None:
    paused(browser, server)
    browser.press(*[RIGHT] * 3)
    at_frame(browser, 3)
    browser.press(LEFT)
    at_frame(browser, 2)
    browser.press(SPACE)
    at_frame(browser, FRAMES - 1)
    focusable = browser.run(
        "const wanted = 'button:not([hidden]):not(:disabled), select, [tabindex=\"0\"]';"
        "return [...document.querySelectorAll(wanted)].map((e) => e.id || e.dataset.module)"
    )
    assert {"play", "next", "back", "kinds", "speed", "timeline", "avoid", "cruise"} <= set(focusable)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", SIZES)
def test_it_passes_axe(browser: Browser, server: PageServer, size: str, scheme: str) -> None:
    if not AXE.exists():
        pytest.skip("needs axe-core, which `make browser` fetches")
    browser.resize(size)
    browser.prefer(scheme)
    paused(browser, server)
    browser.run(AXE.read_text() + "; window.axe = axe")
    result = browser.driver.execute_async_script(
        "const done = arguments[0]; axe.run().then((r) => done(r.violations.map((v) =>"
        " [v.id, v.nodes.map((n) => n.html.slice(0, 200))])))"
    )
    assert not result, "\n".join(f"{name}: {nodes}" for name, nodes in result)


@pytest.mark.parametrize(("size", "is_whole"), [("desktop", True), ("tablet", False), ("phone", False)])
def test_nothing_is_cut_off_sideways(browser: Browser, server: PageServer, size: str, is_whole: bool) -> None:
    browser.resize(size)
    shown(browser, server)
    browser.run("for (const name of ['follow', 'stop']) document.getElementById(name).hidden = false")
    browser.run("document.getElementById('message').textContent = 'a long message of the robot, '.repeat(4)")
    root = "document.documentElement"
    assert browser.run(f"return {root}.scrollWidth <= {root}.clientWidth")
    if is_whole:
        assert browser.run(f"return {root}.scrollHeight <= {root}.clientHeight")


@contextmanager
def another_site(content: str) -> Iterator[str]:
    """Serve a page of another origin; the value is its address."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(content.encode())

        def log_message(self, *_: object) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as site:
        thread = threading.Thread(target=site.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{site.server_port}/"
        site.shutdown()
        thread.join()


ATTACK = """<!doctype html><script>
const socket = new WebSocket("ws://HOST/run", ["colony.watch", "TOKEN"]);
socket.onopen = () => { document.title = "open"; socket.send('{"do": "stop"}'); };
socket.onclose = () => { document.title = "refused"; };
const frame = document.createElement("iframe");
frame.src = "http://HOST/#TOKEN";
document.documentElement.append(frame);
</script>"""


def test_a_page_of_another_origin_cannot_press_the_stop(browser: Browser) -> None:
    pressed = []

    def stop() -> StopAnswer:
        pressed.append(True)
        return StopAnswer(is_kept=True, text="stopped; acknowledged by all")

    with recorded(stop) as watched, served(watched) as server:
        host, token = server.url.removeprefix("http://").split("/#")
        with another_site(ATTACK.replace("HOST", host).replace("TOKEN", token)) as address:
            browser.open(address)
            until(lambda: browser.run("return document.title") == "refused", "the socket is refused")
        assert pressed == []
        shown(browser, server).click("#stop")
        until(lambda: "acknowledged" in browser.text("#message"), "the page's own button works")
    assert pressed == [True]


def test_the_stop_button_stays_where_it_is_when_a_client_is_late(browser: Browser) -> None:
    place = "const b = document.querySelector('#stop').getBoundingClientRect(); return [b.x, b.y]"
    with recorded(lambda: StopAnswer(is_kept=True, text="")) as watched, served(watched) as server:
        browser.resize("phone")
        paused(browser, server)
        before = browser.run(place)
        browser.run("document.querySelector('#kinds').value = '8'")
        browser.press("n")
        at_frame(browser, 8)
        assert browser.text("#alarms") == "drive/cruise late"
        assert browser.run(place) == before
        browser.resize("desktop")


def test_what_is_too_long_for_a_line_goes_on_further_in(browser: Browser, server: PageServer) -> None:
    browser.resize("phone")
    paused(browser, server)
    browser.run("document.querySelector('[data-module=cruise]').focus()")
    browser.press(ENTER)
    until(lambda: "frame 0" in browser.text("#reason-title"), "an answer comes")
    lines = "return [...document.querySelectorAll('#reason-text div')].map("
    margins = browser.run(f"{lines}e => parseFloat(getComputedStyle(e).marginLeft))")
    indents = browser.run(f"{lines}e => parseFloat(getComputedStyle(e).textIndent))")
    assert len(margins) > 1
    assert min(margins) == -indents[0] > 0
    assert len(set(margins)) > 1
    browser.resize("desktop")


class Stranger:
    """Another program at the address of an open page: it takes every WebSocket, and notes what it gets."""

    def __init__(self, host: str) -> None:
        self.greeted, self.got = threading.Event(), list[str]()
        address, port = host.split(":")
        self._server = serve(
            self._serve, address, int(port), subprotocols=[Subprotocol(PROTOCOL)], compression=None
        )
        self._thread = threading.Thread(target=self._server.serve_forever)
        self._thread.start()

    def _serve(self, socket: ServerConnection) -> None:
        self.got += map(str, socket.request.headers.raw_items())
        socket.send('{"nonce": "00", "proof": "00"}')
        socket.send('{"scene": {"title": "false"}}')
        self.greeted.set()
        self.got += map(str, socket)

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join()


def test_a_stranger_at_the_port_gets_no_token_and_shows_nothing(browser: Browser) -> None:
    with recorded() as watched:
        with served(watched) as server:
            host, token = server.host, server.url.partition("#")[2]
            shown(browser, server)
            title = browser.text("#title")
        with closing(Stranger(host)) as stranger:
            until(stranger.greeted.is_set, "the page reconnects")
            until(lambda: "another program" in browser.text("#message"), "the page says so")
            browser.press(SPACE)
            assert browser.text("#mode") == "no connection"
            assert browser.text("#title") == title
        assert any(PROTOCOL in each for each in stranger.got)
        assert not any(token in each or '"do"' in each for each in stranger.got)


def test_the_link_leads_to_the_page(browser: Browser, server: PageServer, tmp_path: Path) -> None:
    link = page_link({"XDG_CACHE_HOME": str(tmp_path)}, server.url)
    assert link is not None
    assert TOKEN not in link
    [file] = tmp_path.rglob("*.html")
    assert file.stat().st_mode & 0o077 == 0
    browser.open(link)
    until(lambda: "frame" in browser.text("#clock"), "a frame is shown")
