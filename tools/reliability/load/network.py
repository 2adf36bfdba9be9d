# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Network namespaces around a bridge, with Fast DDS's discovery server, and links that can break.

Everything, the bridge and the server too, lies in namespaces of its own: nothing of the machine's
network is touched, and the names hold the process's id.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from vislam_ros.cli.domain import local_graph
from vislam_ros.errors import VislamError

_HUB = "hub"
_BRIDGE = "bridge"
_UPLINK = "uplink"
_SUBNET = "10.77.0"
_SERVER = f"{_SUBNET}.1"
_PORT = 11811


class Network:
    """A namespace for each member, a bridge between them, and a discovery server at it.

    Parameters
    ----------
    members : sequence of str

    Attributes
    ----------
    namespaces : dict of str to str
        Name of each member's namespace.
    environment : dict of str to str
        For processes in them.
    """

    def __init__(self, members: Sequence[str]):
        self._links = {member: f"link{k}" for k, member in enumerate(members)}
        self.namespaces = {member: _name(member) for member in members}
        self.environment = {
            **os.environ,
            **local_graph(),
            "ROS_DOMAIN_ID": "0",
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
            "ROS_DISCOVERY_SERVER": f"{_SERVER}:{_PORT}",
            # Or nodes know only whom they talk to, and the player cannot look at the graph.
            "ROS_SUPER_CLIENT": "TRUE",
            # Shared memory would go past the links.
            "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        }

    def cut(self, member: str) -> None:
        """Take a member's link down."""
        _ip("-n", _name(_HUB), "link", "set", self._links[member], "down")

    def heal(self, member: str) -> None:
        """Bring it up again."""
        _ip("-n", _name(_HUB), "link", "set", self._links[member], "up")

    def build(self) -> None:
        """Make the namespaces and their links."""
        hub = _name(_HUB)
        for name in (hub, *self.namespaces.values()):
            _ip("netns", "add", name)
            _ip("-n", name, "link", "set", "lo", "up")
        _ip("-n", hub, "link", "add", _BRIDGE, "type", "bridge")
        _ip("-n", hub, "address", "add", f"{_SERVER}/24", "dev", _BRIDGE)
        _ip("-n", hub, "link", "set", _BRIDGE, "up")
        for k, (member, name) in enumerate(self.namespaces.items()):
            link = self._links[member]
            _ip(
                *("-n", hub, "link", "add", link, "type", "veth"),
                *("peer", "name", _UPLINK, "netns", name),
            )
            _ip("-n", hub, "link", "set", link, "master", _BRIDGE, "up")
            _ip("-n", name, "address", "add", f"{_SUBNET}.{k + 2}/24", "dev", _UPLINK)
            _ip("-n", name, "link", "set", _UPLINK, "up")

    def remove(self) -> None:
        """Take away what is there of it."""
        for name in (_name(_HUB), *self.namespaces.values()):
            with suppress(VislamError):
                _ip("netns", "delete", name)


def _name(member: str) -> str:
    return f"vislam-{os.getpid()}-{member.replace('_', '-')}"


def _ip(*arguments: str) -> None:
    try:
        subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True)
    except FileNotFoundError as error:
        raise VislamError("ip: is not installed: install iproute2") from error
    except subprocess.CalledProcessError as error:
        said = error.stderr.strip() or f"exit code {error.returncode}"
        raise VislamError(f"ip {' '.join(arguments)}: {said} (it takes root)") from error


@contextmanager
def network(members: Sequence[str]) -> Iterator[Network]:
    """Build a network with a running discovery server, and take it away after the block.

    Raises
    ------
    VislamError
        Where this machine does not let it, or has no discovery server.
    """
    built = Network(members)
    with ExitStack() as stack:
        stack.callback(built.remove)
        built.build()
        stack.enter_context(_discovery_server())
        yield built


@contextmanager
def _discovery_server() -> Iterator[None]:
    beside = Path(sys.executable).parent / "fast-discovery-server"
    program = str(beside) if beside.is_file() else shutil.which("fast-discovery-server")
    if program is None:
        raise VislamError("fast-discovery-server: is not installed: it comes with Fast DDS")
    command = [program, "-i", "0", "-l", _SERVER, "-p", str(_PORT)]
    libraries = f"{Path(sys.prefix) / 'lib'}{os.pathsep}{os.environ.get('LD_LIBRARY_PATH', '')}"
    process = subprocess.Popen(
        ["ip", "netns", "exec", _name(_HUB), *command],
        env={**os.environ, "LD_LIBRARY_PATH": libraries},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield
        if process.poll() is not None:
            raise VislamError(f"fast-discovery-server ended with exit code {process.returncode}")
    finally:
        process.kill()
        process.wait()
