"""The table of users as zenoh access control: the keys that each user may send to and listen to.

Everything that is not allowed here is denied. The keys of replies, and of everything that users send, contain
the user's name. This module ties the name to the common name of the certificate, so no user can send
messages, or hear replies, under another name.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from colony.runtime.transport.live import keys
from colony.runtime.transport.live.security import Permission, Security, rights

EVERYTHING = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)

Rule = dict[str, Any]

_HEARD_BY_READERS = ("Clock/ticks", "*/frames", "*/activity/*/frames", "verdicts")
_SENT_BY_READERS = ("*/fetches/{user}",)  # not `**`, which matches any depth and so the calls of other users
_HEARD_BY_RUNNERS = ("*/recalled/**",)
_SENT_BY_RUNNERS = (
    "*/requests/{user}",
    "*/announcements/{user}",
    "*/checkpoints/{user}",
    "Clock/ready/{user}",
    "Clock/restarts/{user}",
)


def access_control(robot: str, security: Security) -> dict[str, Any]:
    """Return a gateway's setting `access_control`."""
    rules: list[Rule] = [_allow("here", EVERYTHING, ("ingress", "egress"), ("**",))]
    subjects: list[dict[str, Any]] = [{"id": "here", "link_protocols": ["unixsock-stream"]}]
    policies = [{"rules": ["here"], "subjects": ["here"]}]
    for number, (user, permissions) in enumerate(security.users.items()):
        subject = f"user-{number}"
        own = list(_rules(subject, robot, user, permissions))
        rules.extend(own)
        subjects.append({"id": subject, "cert_common_names": [user], "link_protocols": ["tls"]})
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [subject]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rules(subject: str, robot: str, user: str, permissions: tuple[Permission, ...]) -> Iterator[Rule]:
    """Yield the rules of one user.

    A sender must learn of the subscribers to its keys, and a subscriber must be sent messages.
    """
    prefix, allowed = keys.prefix(robot), rights(permissions)
    sends = [f"*/call/{right}/{user}/*" for right in allowed]
    hears = [f"*/reply/{user}/*"]
    if "read" in allowed:
        sends += [key.format(user=user) for key in _SENT_BY_READERS]
        hears += _HEARD_BY_READERS
    if "run" in permissions:
        sends += [key.format(user=user) for key in _SENT_BY_RUNNERS]
        hears += _HEARD_BY_RUNNERS
        # tokens of clients; a server's is shorter
        tokens = (keys.alive(robot, "*/*"), keys.alive(robot, "*/*/*"))
        yield _allow(f"{subject}-is-there", ("liveliness_token",), ("ingress",), tokens)
    yield _allow(f"{subject}-sends", ("put",), ("ingress",), [prefix + key for key in sends])
    yield _allow(f"{subject}-listens", ("declare_subscriber",), ("ingress",), [prefix + key for key in hears])
    yield _allow(f"{subject}-hears", ("put",), ("egress",), [prefix + key for key in hears])
    told = ("declare_subscriber", "liveliness_token")
    yield _allow(f"{subject}-is-told", told, ("egress",), (f"{prefix}**",))
    asks = ("liveliness_query", "declare_liveliness_subscriber")
    yield _allow(f"{subject}-asks", asks, ("ingress",), (keys.alive(robot, "**"),))


def _allow(
    name: str, messages: tuple[str, ...], flows: tuple[str, ...], key_exprs: tuple[str, ...] | list[str]
) -> Rule:
    return {
        "id": name,
        "permission": "allow",
        "messages": list(messages),
        "flows": list(flows),
        "key_exprs": list(key_exprs),
    }
