# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Solve a drive, smooth it, and compare it with the truth.

python solve_a_drive.py                       a simulated drive
python solve_a_drive.py DRIVE [REFERENCE.tum] a dataset or a bag of yours
"""

import sys

import matplotlib.pyplot as plt

import vislam_ros as vi


def main(paths: list[str]) -> None:
    """Read or simulate a drive, solve it, print some numbers and draw the path."""
    drive = vi.load_drive(paths[0]) if paths else vi.simulate(steps=200, landmarks=1000).drive
    reference = vi.read_tum(paths[1]) if len(paths) > 1 else drive.ground_truth
    print(f"{drive.name}: {drive.steps} frames, {drive.tracks} tracks, {drive.duration:.0f} s")

    # The filter goes forward; with smooth=True it then goes back, for poses that know the end.
    solution = vi.solve(drive, smooth=True)

    # steps is a table: a column for each number of a step. pandas.DataFrame(solution.steps) works.
    used, rejected = solution.steps["used"].sum(), solution.steps["rejected"].sum()
    print(f"{used} observations used, {rejected} rejected, {len(solution.landmarks)} landmarks")

    paths_drawn = {
        "dead reckoning": solution.dead_reckoning,
        "filter": solution.trajectory,
        "smoothed": solution.smoothed,
    }
    for name, trajectory in paths_drawn.items():
        plt.plot(*trajectory.positions.T[:2], label=name)
        if reference is not None:
            # NEES/6 is about 1 where the covariances tell the truth about the errors.
            errors = vi.evaluate(trajectory, reference)
            print(f"{name}: ATE {errors.ate.rmse:.2f} m, NEES/6 {errors.nees_per_dof:.1f}")
    plt.axis("equal")
    plt.legend()
    plt.savefig("drive.png")


if __name__ == "__main__":
    main(sys.argv[1:])
