# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors that a user can mend: one line that names the file, the field, the value and the cure."""


class VislamError(Exception):
    """A known error. The command line prints its message as one line and exits with 1."""


class SettingsError(VislamError, ValueError):
    """A setting that does not exist, has the wrong type or lies outside its range."""


class OutputError(VislamError):
    """A file cannot be written, now or later: nothing that goes on can mend it."""
