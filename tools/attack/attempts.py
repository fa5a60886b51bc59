"""The attempts of an attacker, and what each right lets through. Expectations are written by hand, not
taken from the code that is attacked."""

from __future__ import annotations

import re
from collections.abc import Iterator

import msgspec
import zenoh

from colony.runtime.library.robot import Drive
from colony.runtime.protocol import codec
from colony.runtime.protocol.calls import Open
from colony.runtime.protocol.messages import Bounds, Call, Ready, Request, Right, SentMessage, Tick
from tests.cli.machine import ROBOT
from tools.attack.intruder import ABUSERS, Attack
from tools.attack.lab import MARK

ROOT = f"colony/{ROBOT}"
RIGHTS: tuple[Right, ...] = ("read", "command", "stop", "unlimited")
REMOTE = zenoh.Locality.REMOTE
SERVERS = ("Clock", "RServer", "DServer", "PServer", "Gateway")

MAY_SEND: dict[str, tuple[str, ...]] = {
    "reader": (r"\w+/call/read/reader/\d+", r"\w+/fetches/reader"),
    "stopper": (r"\w+/call/stop/stopper/\d+",),
    "driver": (r"\w+/call/(command|stop)/driver/\d+",),
    "runner": (
        r"\w+/call/(read|command|stop)/runner/\d+",
        r"\w+/(fetches|requests|announcements|checkpoints)/runner",
        r"Clock/(ready|restarts)/runner",
    ),
}
_FRAMES = (r"Clock/ticks", r"\w+/frames", r"\w+/activity/\w+/frames", r"verdicts")
MAY_HEAR: dict[str, tuple[str, ...]] = {
    "reader": (*_FRAMES, r"\w+/reply/reader/.+"),
    "stopper": (r"\w+/reply/stopper/.+",),
    "driver": (r"\w+/reply/driver/.+",),
    "runner": (*_FRAMES, r"\w+/reply/runner/.+", r"\w+/recalled/.+"),
}


def keys(user: str) -> Iterator[str]:
    """Yield the keys of a robot: a user's own, those of other users, and some that belong to nobody."""
    for server in SERVERS:
        for right in RIGHTS:
            for who in (user, "ada", "fetches", "zoe"):
                yield f"{ROOT}/{server}/call/{right}/{who}/1"
        for topic in ("fetches", "frames", "requests", "announcements", "checkpoints", "ticks", "answers"):
            yield f"{ROOT}/{server}/{topic}"
        for who in (user, "ada"):
            yield f"{ROOT}/{server}/reply/{who}/1"
            for topic in ("fetches", "requests", "announcements", "checkpoints"):
                yield f"{ROOT}/{server}/{topic}/{who}"
    for topic in ("ready", "restarts"):
        yield from (f"{ROOT}/Clock/{topic}{end}" for end in ("", f"/{user}", "/ada"))
    yield f"{ROOT}/verdicts"
    yield f"{ROOT}/DServer/recalled/drive/cruise"
    yield f"{ROOT}/DServer/activity/module/frames"
    yield from ("colony/other/RServer/call/command/ada/1", "elsewhere", "@/router/x", f"{ROOT}/@adv/pub")


PATTERNS = (
    "**",
    "*/**",
    f"{ROOT}/**",
    f"{ROOT}/*/frames",
    f"{ROOT}/RServer/*",
    f"{ROOT}/RServer/call/**",
    f"{ROOT}/*/call/*/*/*",
    f"{ROOT}/*/call/command/a$*/1",
    f"{ROOT}/*/reply/**",
    "@/**",
    "@/*/router/**",
)
TOKENS = tuple(f"{ROOT}/alive/{MARK.decode()}{end}" for end in ("", "/x", "/x/y", "/x/y/z"))


def listen(attack: Attack) -> None:
    """Declare every kind of subscriber, queryable and token that could get something."""
    session = attack.session
    for key in (*PATTERNS, *keys(attack.intruder.user)):
        session.declare_subscriber(key, attack.put("put"), allowed_origin=REMOTE)
    for key in PATTERNS:
        answer = zenoh.handlers.Callback(attack.answer, indirect=False)
        session.declare_queryable(key, answer, complete=True, allowed_origin=REMOTE)
    session.liveliness().declare_subscriber("**", attack.put("token"), history=True)
    for key in TOKENS:
        session.liveliness().declare_token(key)


def send(attack: Attack) -> None:
    """Put, delete and ask on every key and pattern, with the most urgent settings."""
    session = attack.session
    for key in (*keys(attack.intruder.user), *PATTERNS):
        session.put(key, MARK, priority=zenoh.Priority.REAL_TIME, express=True)
        session.delete(key)
    for key in (*PATTERNS, f"{ROOT}/RServer/frames", "@/*/router", "@/*/router/config/**"):
        for reply in session.get(key, payload=MARK, timeout=0.3, allowed_destination=REMOTE):
            if reply.ok is not None:
                attack.heard.append(("reply", str(reply.ok.key_expr)))
    for reply in session.liveliness().get("**", timeout=0.3):
        if reply.ok is not None and MARK.decode() not in str(reply.ok.key_expr):
            attack.heard.append(("token", str(reply.ok.key_expr)))


def drive(attack: Attack) -> None:
    """Try to move the base: by calls under its own name and others' and under every right, by requests of
    clients, and by ticks of a forged Clock."""
    user = attack.intruder.user
    for who in (user, "ada"):
        for right in RIGHTS:
            connection = f"{who}/1"
            for number, (name, arguments) in enumerate(
                (("open", Open(name="x")), ("drive", Drive(velocity=200.0, turn=0.0, lease_s=5.0))), 1
            ):
                call = Call(
                    connection=connection,
                    number=number,
                    method=name,
                    arguments=msgspec.Raw(msgspec.msgpack.encode(arguments)),
                    priority=90,
                    right="command" if name == "drive" else right,
                )
                _send(attack, f"RServer/call/{right}/{connection}", call)
    values = (200.0, 0.0)
    for k in range(1, 200, 10):
        _send(attack, "Clock/ticks", Tick(k=k, t_ns=k * 50_000_000))
        request = Request(k=k, actuator="drive", client="cruise", bid="command", values=values)
        _send(attack, "RServer/requests", request)
        _send(attack, "RServer/requests", Bounds(k=k, actuator="drive", low=values, high=values))
    _send(attack, "Clock/ready", Ready(client="drive/cruise"))


def _send(attack: Attack, topic: str, message: SentMessage) -> None:
    attack.session.put(f"{ROOT}/{topic}", codec.encode(message))


def may_send(user: str, key: str) -> bool:
    """Return whether the robot may receive what an attacker put on this key."""
    return _matches(MAY_SEND.get(user, ()), key)


def may_hear(user: str, kind: str, key: str) -> bool:
    """Return whether an attacker may have heard this."""
    if kind == "token":  # every user may see who is there
        return user in ABUSERS and key.startswith(f"{ROOT}/alive/")
    return kind == "put" and _matches(MAY_HEAR.get(user, ()), key)


def may_claim(user: str, key: str) -> bool:
    """Return whether an attacker may show up under this name: users with `run` show up as clients."""
    return user == "runner" and re.fullmatch(rf"{ROOT}/alive/[^/]+/[^/]+(/[^/]+)?", key) is not None


def _matches(patterns: tuple[str, ...], key: str) -> bool:
    return any(re.fullmatch(f"{ROOT}/{pattern}", key) for pattern in patterns)
