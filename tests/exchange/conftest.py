"""Some scenes, exported once."""

import pytest

from jaxmm.exchange.export import Request, export
from jaxmm.exchange.tasks import ExportSettings

SETTINGS = ExportSettings(sensors=("velodyne-16",), erring_share=0.3)


@pytest.fixture(scope="session")
def exported(tmp_path_factory):
    """The folder of fifteen scenes; the truth of the test split lies beside it."""
    pytest.importorskip("ifcopenshell")
    folder = tmp_path_factory.mktemp("exchange") / "scenes"
    assert export(SETTINGS, folder, Request(15, workers=1)) == {"train": 9, "validation": 3, "test": 3}
    return folder
