"""The table of users as zenoh access control: the keys that each user may publish and subscribe to.

Everything that is not allowed here is denied. The keys of replies, and of all messages from users, contain
the user's name. These rules require it to equal the common name of the certificate, so that no user can send
messages, or receive replies, under another name.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from colony.runtime.transport.live import keys
from colony.runtime.transport.live.security import Permission, Security, rights

ALL_MESSAGE_KINDS = (
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

_READER_SUBSCRIPTIONS = ("Clock/ticks", "*/frames", "*/activity/*/frames", "verdicts")
# not `**`, which matches any depth, and so the calls of other users
_READER_PUBLICATIONS = ("*/fetches/{user}",)
_RUNNER_SUBSCRIPTIONS = ("*/recalled/**", "*/repeats/*")
_RUNNER_PUBLICATIONS = (
    "*/requests/{user}",
    "*/announcements/{user}",
    "*/checkpoints/{user}",
    "Clock/ready/{user}",
    "Clock/restarts/{user}",
)


def access_control(robot: str, security: Security) -> dict[str, Any]:
    """Return a gateway's setting `access_control`."""
    rules: list[Rule] = [_allow("here", ALL_MESSAGE_KINDS, ("ingress", "egress"), ("**",))]
    subjects: list[dict[str, Any]] = [{"id": "here", "link_protocols": ["unixsock-stream"]}]
    policies = [{"rules": ["here"], "subjects": ["here"]}]
    for number, (user, permissions) in enumerate(security.users.items()):
        subject = f"user-{number}"
        user_rules = list(_rules(subject, robot, user, permissions))
        rules.extend(user_rules)
        subjects.append({"id": subject, "cert_common_names": [user], "link_protocols": ["tls"]})
        policies.append({"rules": [rule["id"] for rule in user_rules], "subjects": [subject]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rules(subject: str, robot: str, user: str, permissions: tuple[Permission, ...]) -> Iterator[Rule]:
    """Yield the rules of one user.

    Users must also see the subscribers to their keys, and receive the messages that they subscribe to.
    """
    prefix, allowed = keys.prefix(robot), rights(permissions)
    published = [f"*/call/{right}/{user}/*" for right in allowed]
    subscribed = [f"*/reply/{user}/*"]
    if "read" in allowed:
        published += [key.format(user=user) for key in _READER_PUBLICATIONS]
        subscribed += _READER_SUBSCRIPTIONS
    if "run" in permissions:
        published += [key.format(user=user) for key in _RUNNER_PUBLICATIONS]
        subscribed += _RUNNER_SUBSCRIPTIONS
        # liveliness tokens of clients; a server's token has a single part
        tokens = (keys.liveliness_key(robot, "*/*"), keys.liveliness_key(robot, "*/*/*"))
        yield _allow(f"{subject}-tokens", ("liveliness_token",), ("ingress",), tokens)
    yield _allow(f"{subject}-publishes", ("put",), ("ingress",), [prefix + key for key in published])
    yield _allow(
        f"{subject}-subscribes", ("declare_subscriber",), ("ingress",), [prefix + key for key in subscribed]
    )
    yield _allow(f"{subject}-receives", ("put",), ("egress",), [prefix + key for key in subscribed])
    declarations = ("declare_subscriber", "liveliness_token")
    yield _allow(f"{subject}-learns", declarations, ("egress",), (f"{prefix}**",))
    queries = ("liveliness_query", "declare_liveliness_subscriber")
    yield _allow(f"{subject}-queries", queries, ("ingress",), (keys.liveliness_key(robot, "**"),))


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
