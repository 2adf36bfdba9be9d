# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the project and what lies beside it are."""

import os
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]

_NAMED_DATA = os.environ.get("VISLAM_SHARED_DATA")
SHARED_DATA = Path(_NAMED_DATA) if _NAMED_DATA else REPOSITORY.parent / "shared" / "data"
SHARED_CASES = SHARED_DATA.parent / "cases"
SHARED_IMAGES = SHARED_DATA.parent / "images"
