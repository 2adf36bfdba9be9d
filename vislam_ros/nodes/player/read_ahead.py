# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages of a bag, read before they are due: a chunk of images takes long to unpack."""

import threading
from collections import deque
from collections.abc import Generator, Iterable

from vislam_ros.data.bags.bag_messages import BagConnection

Message = tuple[BagConnection, int, bytes]

MOST_BYTES = 2**26
"""How far the reading runs ahead: a second or two of stereo images, or all of a drive's tracks."""


def read_ahead(
    messages: Iterable[Message], most_bytes: int = MOST_BYTES
) -> Generator[Message, None, None]:
    """Yield messages that a thread reads meanwhile.

    Close the iterator where it is left before its end: that ends the thread. An error of the
    messages is raised after those before it.

    Parameters
    ----------
    messages : iterable of (connection, log time in ns, CDR bytes)
        Used by the thread alone until the iterator is closed.
    most_bytes : int
        Of CDR that are kept; one message is, however large.
    """
    read: deque[Message] = deque()
    changed = threading.Condition()
    kept, is_over, is_left, error = 0, False, False, None

    def has_room() -> bool:
        return kept < most_bytes or is_left

    def read_all() -> None:
        nonlocal kept, is_over, error
        try:
            for message in messages:
                with changed:
                    changed.wait_for(has_room)
                    if is_left:
                        return
                    read.append(message)
                    kept += len(message[2])
                    changed.notify()
        except BaseException as raised:  # whoever takes the messages shall hear of it
            error = raised
        finally:
            with changed:
                is_over = True
                changed.notify()

    thread = threading.Thread(target=read_all, name="read ahead")
    thread.start()
    try:
        while True:
            with changed:
                changed.wait_for(lambda: read or is_over)
                if not read:
                    break
                message = read.popleft()
                kept -= len(message[2])
                changed.notify()
            yield message
        if error is not None:
            raise error
    finally:
        with changed:
            is_left = True
            changed.notify()
        thread.join()
