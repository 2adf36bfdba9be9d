# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a bag calls the topics of a drive: as the graph does, in a namespace, or as it likes.

A bag that has topics in a namespace is that robot's. Any other is put into the namespace as it is
played, and so read as it stands.
"""

import re
from collections.abc import Collection, Iterable, Mapping

from vislam_ros.data.bags.layout import CLOCK, DIAGNOSTICS, STATIC_TRANSFORMS, TRANSFORMS, Topic
from vislam_ros.errors import VislamError

_NAMESPACE = re.compile(r"(/[A-Za-z_]\w*)+")
# One for all robots, whatever their namespaces.
_SHARED = {topic.recorded for topic in (CLOCK, DIAGNOSTICS, STATIC_TRANSFORMS, TRANSFORMS)}
_SHARED |= {"/rosout", "/parameter_events"}


def namespace_of(text: str) -> str:
    """Namespace as names begin with it: absolute, and empty for the outermost one.

    Raises
    ------
    VislamError
        Where it is none.
    """
    namespace = f"/{text.strip('/')}".rstrip("/")
    if namespace and not _NAMESPACE.fullmatch(namespace):
        raise VislamError(f"namespace {text!r}: is none: /robot1 is one, or /fleet/robot1")
    return namespace


def has_namespace(recorded: Iterable[str], namespace: str) -> bool:
    """Whether any of a bag's topics lies in a namespace."""
    return any(name.startswith(f"{namespace}/") for name in recorded)


def played_name(name: str, recorded: Collection[str], namespace: str) -> str:
    """Name under which a topic of a bag is played in a namespace."""
    if name in _SHARED or has_namespace(recorded, namespace):
        return name
    return namespace + name


def names_in_bag(
    topics: Collection[Topic],
    recorded: Collection[str],
    namespace: str = "",
    renamed: Mapping[str, str] | None = None,
) -> dict[Topic, str]:
    """Name of each topic in a bag, whether the bag has it or not.

    Parameters
    ----------
    topics : collection of Topic
    recorded : collection of str
        Topics that the bag has.
    namespace : str
        Of :func:`namespace_of`.
    renamed : mapping of str to str, optional
        The bag's name for a topic by ours, such as ``{TWIST.name: "/car/twist"}``.

    Raises
    ------
    VislamError
        Where a topic is renamed that is not among them.
    """
    inside = namespace if has_namespace(recorded, namespace) else ""
    names = {topic: inside + topic.recorded for topic in topics}
    known = {topic.recorded: topic for topic in topics}
    for ours, name in (renamed or {}).items():
        full = f"/{ours.lstrip('/')}"
        topic = known.get(full) or known.get(full.removeprefix(namespace))
        if topic is None:
            raise VislamError(
                f"topic {ours!r} cannot be remapped: choose from "
                + ", ".join(topic.name for topic in names)
            )
        names[topic] = name if name.startswith("/") else f"{inside}/{name}"
    return names


def hint(topic: Topic, recorded: Collection[str]) -> str:
    """What to do about a topic that a bag does not have under the name that it should."""
    spaces = [name.removesuffix(topic.recorded) for name in recorded]
    spaces = sorted(
        {space for space, name in zip(spaces, recorded, strict=True) if space and space != name}
    )
    if spaces:
        return f"it has it in the namespace {' and '.join(spaces)}: give that with --namespace"
    has = ", ".join(sorted(recorded)) or "none"
    return f"give one that it has with --remap {topic.name}:=NAME: {has}"
