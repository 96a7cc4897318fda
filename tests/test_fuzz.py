"""A hundred damages to a valid file of every reader: each is read or refused in one line. `make fuzz` runs 10,000."""

import numpy as np
import pytest

from tests.cases.damage import damaged
from tests.cases.valid_beside import FOLDERS, POSES
from tests.cases.valid_files import MODELS, PRIORS, SCANS, crc32c
from tests.cases.valid_inside import INSIDE
from tests.fuzz import run

COUNT = 100
LIBRARIES = {"bag": "rosbags", "pcd": "pypcd4", "e57": "pye57", "las": "laspy", "laz": "lazrs", "ifc": "ifcopenshell"}


@pytest.mark.parametrize(
    "names", [SCANS, INSIDE, FOLDERS | POSES, PRIORS, MODELS], ids=["scans", "inside", "beside", "priors", "models"]
)
def test_damaged_files_are_read_or_refused_in_one_line(names):
    for name in names:
        if library := LIBRARIES.get(name[:3]):
            pytest.importorskip(library)
    failures = run(list(names), 0, COUNT)
    told = [
        f"python -m tests.fuzz --reader {name} --first {number} --count 1: {why}" for (name, number), why in failures
    ]
    assert not told, "\n".join(told)


def test_a_case_is_its_reader_and_its_number():
    valid = SCANS["ply-binary"]()
    again = [damaged("ply-binary", SCANS["ply-binary"](), number) for number in range(50)]
    assert again == [damaged("ply-binary", valid, number) for number in range(50)]
    assert len(set(again)) > 45 and sum(made == valid.data for made in again) < 5
    assert damaged("ply-text", valid, 3) != again[3]


def test_pages_of_e57_get_right_checksums():
    assert crc32c(b"123456789") == 0xE3069283  # the check value that the standard gives
    valid = pytest.importorskip("pye57") and SCANS["e57"]()
    assert valid.wrap(valid.data, valid.unwrap(valid.data)) == valid.data
    assert np.frombuffer(valid.data, "u1").size % 1024 == 0
