# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the processes of a graph meet: on this machine, and on a domain of their own.

So runs beside each other never meet.
"""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from vislam_ros.cli.parameters import shared_file
from vislam_ros.errors import VislamError

# Above 101 the ports of a domain lie among those that Linux hands out by itself.
_DOMAINS = 101
# DDS-RTPS 9.6.1: unicast discovery port of the first participant of a domain.
_FIRST_PORT, _PORTS_OF_A_DOMAIN = 7410, 250


def local_graph() -> dict[str, str]:
    """Environment of processes that meet on this machine alone, with this package's Fast DDS."""
    profiles = shared_file("fastdds.xml")
    return {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        **({"FASTRTPS_DEFAULT_PROFILES_FILE": str(profiles)} if profiles else {}),
    }


@contextmanager
def own_domain(first: int | None = None) -> Iterator[int]:
    """Choose a domain id that nobody uses, and keep it for the block.

    Among runs the choice is exclusive: each holds a socket with the domain's name, which goes
    with the process however it ends. A domain with another participant on this machine is
    passed over.

    Parameters
    ----------
    first : int, optional
        Where to begin to look; by default another one for each process.
    """
    begin = os.getpid() if first is None else first
    for k in range(_DOMAINS):
        domain = 1 + (begin + k) % _DOMAINS
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as claim:
            try:
                claim.bind(f"\0vislam_ros_domain_{domain}")
            except OSError:
                continue
            if _is_quiet(domain):
                yield domain
                return
    raise VislamError(
        f"ROS_DOMAIN_ID: all domains from 1 to {_DOMAINS} are in use: set one to use it anyway"
    )


def _is_quiet(domain: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", _FIRST_PORT + _PORTS_OF_A_DOMAIN * domain))
        except OSError:
            return False
    return True
