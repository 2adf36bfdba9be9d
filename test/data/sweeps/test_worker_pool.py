# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
import os
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from pathlib import Path

import pytest
from pool_tasks import MURDEROUS, WRONG, process_id, scaled

from vislam_ros.data.sweeps.worker_pool import in_processes, on_dask
from vislam_ros.errors import VislamError

PARENT = """
import sys, time
from pool_tasks import process_id
from vislam_ros.data.sweeps.worker_pool import in_processes
if __name__ == "__main__":
    for _, pid in in_processes(process_id, None, range(10), 1):
        print(pid, flush=True)
        time.sleep(100)
"""


def wait_for_end(pid: int) -> None:
    deadline = time.monotonic() + 20
    while True:
        try:
            if "\nState:\tZ" in Path(f"/proc/{pid}/status").read_text():
                return
        except (FileNotFoundError, ProcessLookupError):
            return
        assert time.monotonic() < deadline, f"{pid} still runs"
        time.sleep(0.02)


def test_every_task_has_its_result_or_its_error_even_when_a_process_dies() -> None:
    tasks = [1, 2, -WRONG, 3, -MURDEROUS, 4, 5]
    outcomes = dict(in_processes(scaled, 10, tasks, jobs=2))
    assert sorted(outcomes) == list(range(len(tasks)))
    assert [outcomes[k] for k in (0, 1, 3, 5, 6)] == [10, 20, 30, 40, 50]
    assert isinstance(outcomes[2], ValueError)
    assert isinstance(outcomes[4], BrokenProcessPool)


def test_closing_the_results_ends_the_processes() -> None:
    outcomes = in_processes(process_id, None, range(100), jobs=1)
    with closing(outcomes):
        _, pid = next(outcomes)
        assert isinstance(pid, int)
        assert pid != os.getpid()
    wait_for_end(pid)


def test_a_killed_parent_leaves_no_process(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    with subprocess.Popen(
        [sys.executable, str(script)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ) as parent:
        assert parent.stdout is not None
        worker = int(parent.stdout.readline())
        parent.send_signal(signal.SIGKILL)
    wait_for_end(worker)


def test_dask_gives_the_same_results() -> None:
    distributed = pytest.importorskip("distributed", reason="needs the extra dask")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        outcomes = dict(on_dask(scaled, 10, [1, -WRONG, 3], cluster.scheduler_address))
    assert (outcomes[0], outcomes[2]) == (10, 30)
    assert isinstance(outcomes[1], ValueError)


def test_without_dask_or_its_scheduler_one_line_tells(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(VislamError, match="pip install"):
        next(on_dask(scaled, 10, [1], "tcp://127.0.0.1:1"))


def test_an_address_without_scheduler_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="needs the extra dask")
    monkeypatch.setattr("vislam_ros.data.sweeps.worker_pool._CONNECT_SECONDS", 0.5)
    with pytest.raises(VislamError, match=r"tcp://127\.0\.0\.1:1: no Dask scheduler"):
        next(on_dask(scaled, 10, [1], "tcp://127.0.0.1:1"))
