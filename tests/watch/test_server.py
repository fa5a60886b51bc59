"""The server of pages, over real sockets: what a page gets, and what others are refused."""

from __future__ import annotations

import http.client
import socket
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from colony.watch.serving import (
    MAX_STRANGERS,
    PROTOCOL,
    REFUSED,
    REPLACED,
    Admission,
    PageServer,
    page_files,
    proof,
)
from colony.watch.viewer import UNSUPPORTED
from colony.watch.watched import StopAnswer
from tests.waiting import until
from tests.watch.runs import FRAMES, TOKEN, greeted, page, recorded, scene, served


@pytest.fixture(scope="module")
def server() -> Iterator[PageServer]:
    with recorded() as watched, served(watched) as server:
        yield server


UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Protocol": f"{PROTOCOL}, nonce",
}


def get(
    server: PageServer,
    path: str,
    host: str | None = None,
    method: str = "GET",
    headers: dict[str, str] | None = None,
) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    connection.request(method, path, headers={"Host": host or server.host} | (headers or {}))
    response = connection.getresponse()
    response.read()
    connection.close()
    return response


def test_a_page_gets_the_scene_then_frames(server: PageServer) -> None:
    with page(server.host) as opened:
        first = opened.until(lambda m: True)
        assert first["scene"]["robot"] == "tiny"
        assert (first["live"], first["may_stop"]) == (False, False)
        assert opened.until(lambda m: "history" in m)["path"]
        opened.until(lambda m: "snapshot" in m)
        timeline = opened.until(lambda m: "timeline" in m)["timeline"]
        assert len(timeline["times"]) == FRAMES


def test_a_page_scrubs_and_jumps(server: PageServer) -> None:
    with page(server.host) as opened:
        opened.ask(do="pause")
        opened.ask(do="seek", t=1.05)
        assert opened.shown(10)["commands"][0]["by"] == "cruise"
        opened.ask(do="jump", kinds=2)
        assert opened.shown(15)["contracts"] == ["held", "broken"]
        opened.ask(do="jump", kinds=2)
        assert "nothing" in opened.until(lambda m: "refused" in m)["refused"]
        opened.ask(do="jump", kinds=8, backward=True)
        assert opened.shown(8)["late"] == ["drive/cruise late"]
        opened.ask(do="step", frames=-1)
        opened.shown(7)


def test_what_is_no_request_is_refused(server: PageServer) -> None:
    with page(server.host) as opened:
        for members in (
            {"do": "explode"},
            {},
            {"do": "play", "speed": -1},
            {"do": "ask", "module": "x", "k": 0},
        ):
            opened.ask(**members)
            assert opened.until(lambda m: "refused" in m)["refused"]
        opened.ask(do="stop")
        assert "may not" in opened.until(lambda m: "refused" in m)["refused"]


def test_a_binary_message_closes_the_page_that_sent_it(server: PageServer) -> None:
    with page(server.host) as opened:
        opened.send(b'{"do": "pause"}')
        with pytest.raises(ConnectionClosed) as closed:
            opened.until(lambda m: False)
    assert closed.value.rcvd.code == UNSUPPORTED


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "", "http://localhost:{port}"])
def test_other_origins_are_refused(server: PageServer, origin: str) -> None:
    own = origin.format(port=server.port)
    with pytest.raises(InvalidStatus, match="403"), greeted(server.host, origin=own):
        pass


@pytest.mark.parametrize("token", ["another-token", "", TOKEN[:-1]])
def test_wrong_tokens_are_refused(server: PageServer, token: str) -> None:
    with page(server.host, token=token) as opened, pytest.raises(ConnectionClosed) as closed:
        opened.until(lambda m: True)
    assert closed.value.rcvd.code == REFUSED


@pytest.mark.parametrize(
    "reply", [b"binary", "no JSON", "{}", '{"proof": 1}', r'{"proof": "\ud800"}', '{"do": "stop"}']
)
def test_what_is_no_proof_is_refused(server: PageServer, reply: str | bytes) -> None:
    with greeted(server.host) as (socket, _, _):
        socket.send(reply)
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=60)
    assert closed.value.rcvd.code == REFUSED


def test_the_server_proves_itself_and_sends_no_token(server: PageServer) -> None:
    with greeted(server.host) as (_, nonce, greeting):
        assert greeting.proof == proof(TOKEN, "server", nonce, server.host)
        assert TOKEN not in repr(greeting)


def test_a_proof_is_of_no_use_to_others(server: PageServer) -> None:
    """Not of the server to a page's nonce, not to a second nonce, and not to another server."""
    with greeted(server.host) as (_, _, earlier), greeted(server.host) as (_, nonce, greeting):
        assert greeting.nonce != earlier.nonce
        useless = (
            greeting.proof,
            proof(TOKEN, "server", greeting.nonce, server.host),
            proof(TOKEN, "page", nonce, server.host),
            proof(TOKEN, "page", earlier.nonce, server.host),
            proof(TOKEN, "page", greeting.nonce, "127.0.0.1:1"),
        )
        admission = Admission(port=server.port, token=TOKEN)
        assert not any(admission.accepts(each, greeting.nonce) for each in useless)
        assert admission.accepts(proof(TOKEN, "page", greeting.nonce, server.host), greeting.nonce)


@pytest.mark.parametrize("path", ["/", "/main.js", "/index.html/", "/run", "/run/", "//", "/../a/b", "*"])
def test_another_host_is_refused_before_anything_is_looked_for(server: PageServer, path: str) -> None:
    for method in ("GET", "HEAD", "POST", "OPTIONS", "CONNECT"):
        assert get(server, path, host="rebound.example", method=method).status == 421
    assert get(server, path, host="rebound.example", headers=UPGRADE).status == 421


def test_every_file_has_a_strict_policy(server: PageServer) -> None:
    assert {"index.html", "main.js", "style.css"} <= page_files().keys()
    for name in ("", *page_files()):
        response = get(server, f"/{name}")
        policy = response.headers["Content-Security-Policy"]
        assert response.status == 200
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert response.headers["X-Content-Type-Options"] == "nosniff"
    for path in ("/../app.py", "/secret", "/index.html/", "/run"):
        assert get(server, path).status == 404


def test_only_the_loopback_interface_listens(server: PageServer) -> None:
    with open("/proc/net/tcp") as table:
        local = [line.split()[1] for line in table if line.split()[1].endswith(f":{server.port:04X}")]
    assert {address.partition(":")[0] for address in local} == {"0100007F"}


def test_the_stop_is_pressed_by_who_may() -> None:
    pressed = []

    def stop() -> StopAnswer:
        pressed.append(True)
        return StopAnswer(is_kept=True, text="stopped")

    with recorded(stop) as watched, served(watched) as server, page(server.host) as opened:
        assert opened.until(lambda m: "scene" in m)["may_stop"]
        opened.ask(do="stop")
        assert opened.until(lambda m: "stop" in m)["stop"] == {"is_kept": True, "text": "stopped"}
    assert pressed == [True]


def test_params_are_changed_by_who_may() -> None:
    with recorded() as watched:
        with served(watched) as server, page(server.host) as opened:
            assert not opened.until(lambda m: "scene" in m)["may_tune"]
            opened.ask(do="tune", param="clearance", value=1.0)
            assert opened.until(lambda m: "refused" in m)["refused"] == "this page may not change params"
        asked = list[str]()
        is_free = threading.Event()

        def tune(values: Mapping[str, float]) -> str:
            asked.append(text := " ".join(f"{param} is {value}" for param, value in values.items()))
            is_free.wait(60)
            return text

        tuning = replace(watched, tune=tune)
        with served(tuning) as server, page(server.host) as opened:
            assert opened.until(lambda m: "scene" in m)["may_tune"]
            opened.ask(do="tune", param="clearance", value=1)
            until(lambda: asked, "the robot is asked")
            opened.ask(do="tune", param="clearance", value=2)
            opened.ask(do="tune", param="roaming", value=3)
            opened.ask(do="tune", param="clearance", value=1.5)
            opened.ask(do="tune", param=5)
            opened.until(lambda m: "refused" in m)  # so that all were heard
            is_free.set()
            assert opened.until(lambda m: "tuned" in m)["tuned"] == "clearance is 1.0"
            assert opened.until(lambda m: "tuned" in m)["tuned"] == "clearance is 1.5 roaming is 3.0"


@pytest.mark.parametrize("sent", ["nothing", "half a request", "a handshake without a proof"])
def test_connections_beyond_the_limit_close_the_oldest_but_no_page(sent: str) -> None:
    def stop() -> StopAnswer:
        return StopAnswer(is_kept=True, text="stopped")

    with (
        recorded(stop) as watched,
        served(watched) as server,
        page(server.host) as opened,
        ExitStack() as resources,
    ):
        opened.until(lambda m: "scene" in m)
        lines = {"GET /run HTTP/1.1": "", "Host": server.host, "Origin": f"http://{server.host}"} | UPGRADE
        handshake = "".join(
            f"{name}: {value}\r\n" if value else f"{name}\r\n" for name, value in lines.items()
        )
        data = {"nothing": "", "half a request": handshake}.get(sent, f"{handshake}\r\n").encode()
        strangers = []
        for _ in range(MAX_STRANGERS + 1):
            stranger = socket.create_connection(("127.0.0.1", server.port), timeout=60)
            strangers.append(resources.enter_context(stranger))
            stranger.sendall(data)
        with suppress(ConnectionResetError):
            while strangers[0].recv(4096):
                pass
        opened.ask(do="stop")
        assert opened.until(lambda m: "stop" in m)["stop"]["text"] == "stopped"
        assert get(server, "/").status == 200


def test_a_stop_does_not_wait_for_an_answer() -> None:
    is_stopped = threading.Event()

    def stop() -> StopAnswer:
        is_stopped.set()
        return StopAnswer(is_kept=True, text="stopped")

    def explain(k: int, module: str) -> tuple[str, ...]:
        return ("after the stop" if is_stopped.wait(10) else "no stop came",)

    with (
        recorded(stop) as watched,
        served(replace(watched, explain=explain)) as server,
        page(server.host) as opened,
    ):
        for k in range(3):
            opened.ask(do="ask", module="cruise", k=k)
        opened.ask(do="stop")
        newest = opened.until(lambda m: m.get("answer", {}).get("k") == 2)
        assert newest["answer"]["lines"] == ["after the stop"]


def test_pages_come_back_for_the_run_that_follows() -> None:
    with recorded() as first, recorded() as second, served(first) as server:
        with page(server.host) as opened:
            opened.until(lambda m: "snapshot" in m)
            server.show(replace(second, scene=scene("the second")))
            with pytest.raises(ConnectionClosed) as closed:
                opened.until(lambda m: False)
            assert closed.value.rcvd.code == REPLACED
        with page(server.host) as opened:
            assert opened.until(lambda m: "scene" in m)["scene"]["title"] == "the second"
