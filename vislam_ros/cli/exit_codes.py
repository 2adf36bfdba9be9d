# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a command returns to the shell; wrong usage is argparse's 2."""

OK = 0
FAILED = 1
INTERRUPTED = 130
PIPE_CLOSED = 141  # as a shell names an end by SIGPIPE
