# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What ``solve`` and ``run`` say at their end comes next."""

from pathlib import Path

import pytest

from vislam_ros.cli.ending import tell_written


@pytest.mark.parametrize(
    ("verdicts", "command"),
    [
        (("good",), "evaluate out --reference REF.tum"),
        (("doubtful", "good"), "evaluate out --reference REF.tum"),
        ((None,), "evaluate out --reference REF.tum"),
        (("good", "contradiction"), "inspect drive.npz"),
    ],
)
def test_of_data_that_contradict_themselves_inspect_comes_next(
    verdicts: tuple[str | None, ...],
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("out").mkdir()
    tell_written([(Path("out"), {"verdict": word}) for word in verdicts], Path("drive.npz"))
    assert capsys.readouterr().err.splitlines()[-1] == f"next: vislam {command}"
