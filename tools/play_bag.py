#!/usr/bin/env python3
# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The same as ``vislam play``."""

import sys

from vislam_ros.cli.main import main

if __name__ == "__main__":
    sys.exit(main(["play", *sys.argv[1:]]))
