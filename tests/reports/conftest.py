"""What several tests of reports share."""

import pytest

from jaxmm.reports import figures


@pytest.fixture
def coarse(monkeypatch):
    """Few pixels, for speed."""
    monkeypatch.setitem(figures.STYLE, "savefig.dpi", 50)
