"""The folder of real data that some tests read."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Folder of real scans and weights (JAXMM_DATA, default ../shared/data); skips where there is none."""
    root = Path(os.environ.get("JAXMM_DATA") or Path(__file__).resolve().parents[1] / "../shared/data").resolve()
    if not root.is_dir():
        pytest.skip(f"needs real data: JAXMM_DATA names no folder ({root})")
    return root
