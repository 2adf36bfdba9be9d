# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A function over many tasks, on the cores of this machine or on a Dask cluster.

The function must be importable by name, since the processes are spawned: a fork of a process
that has used DDS hangs.
"""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

import threadpoolctl

from vislam_ros.errors import VislamError

Shared = TypeVar("Shared")
Task = TypeVar("Task")
Result = TypeVar("Result")

_CONNECT_SECONDS = 10

# Set in each worker process, once.
_work: Callable[[Any], Any] | None = None


def available_cores() -> int:
    """Cores that this process may run on."""
    return len(os.sched_getaffinity(0))


def in_processes(
    function: Callable[[Shared, Task], Result],
    shared: Shared,
    tasks: Sequence[Task],
    jobs: int,
) -> Generator[tuple[int, Result | Exception], None, None]:
    """Yield (index of the task, result or what the function raised) as the tasks end.

    When a process dies, what was running has one more go, each task alone; the one that ends its
    process again gives a BrokenProcessPool, and the others go on. When the iterator is closed or
    this process ends, however that may be, the worker processes end at once.

    Parameters
    ----------
    function : callable
        Called as ``function(shared, task)``.
    shared : object
        Sent to each process once.
    tasks : sequence
    jobs : int
        Processes at a time.
    """
    waiting = deque(range(len(tasks)))
    while waiting:
        lost: list[int] = []
        with _pool(function, shared, min(jobs, len(waiting))) as pool:
            running: dict[Future[Result], int] = {}
            while running or (waiting and not lost):
                while waiting and len(running) < jobs and not lost:
                    index = waiting.popleft()
                    try:
                        running[pool.submit(_do, tasks[index])] = index
                    except BrokenProcessPool:
                        lost.append(index)
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    index, outcome = running.pop(future), _outcome(future)
                    if isinstance(outcome, BrokenProcessPool):
                        lost.append(index)
                    else:
                        yield index, outcome
        for index in sorted(lost):
            with _pool(function, shared, 1) as pool:
                yield index, _outcome(pool.submit(_do, tasks[index]))


@contextmanager
def _pool(
    function: Callable[[Any, Any], Any], shared: Any, jobs: int
) -> Iterator[ProcessPoolExecutor]:
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(
        jobs,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_worker,
        initargs=(function, shared),
    )
    try:
        yield pool
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        pool.shutdown()


def _start_worker(function: Callable[[Any, Any], Any], shared: Any) -> None:
    global _work
    # Ctrl-C goes to the whole group; the parent decides what becomes of its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    threadpoolctl.threadpool_limits(1)

    def work(task: Any) -> Any:
        return function(shared, task)

    _work = work


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _do(task: Any) -> Any:
    assert _work is not None
    return _work(task)


def _outcome(future: Any) -> Any:
    """Return what a future of either kind gives, or what it raises."""
    try:
        return future.result()
    except Exception as error:
        return error


def on_dask(
    function: Callable[[Shared, Task], Result],
    shared: Shared,
    tasks: Sequence[Task],
    address: str,
) -> Generator[tuple[int, Result | Exception], None, None]:
    """Do the same on the workers of a Dask cluster, which need this package installed.

    Parameters
    ----------
    function, shared, tasks
        As for :func:`in_processes`.
    address : str
        Of the scheduler, such as ``tcp://host:8786``.

    Raises
    ------
    VislamError
        Where dask.distributed is not installed or the scheduler does not answer.
    """
    try:
        import distributed
    except ImportError as error:
        raise VislamError(
            "a Dask cluster needs the package distributed: pip install 'vislam_ros[dask]'"
        ) from error
    try:
        client = distributed.Client(address, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise VislamError(f"{address}: no Dask scheduler answers here: {error}") from error
    with client:
        everywhere = client.scatter(shared, broadcast=True, hash=False)
        futures = {
            client.submit(function, everywhere, task, pure=False): index
            for index, task in enumerate(tasks)
        }
        try:
            for future in distributed.as_completed(futures, loop=client.loop):
                yield futures[future], _outcome(future)
        finally:
            client.cancel(list(futures))
