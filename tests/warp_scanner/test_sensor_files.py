"""Sensors from TOML files: what comes back, and the one line that bad files end in."""

import numpy as np
import pytest

from warp_scanner.scenes import scenes
from warp_scanner.sensors import sensor_files
from warp_scanner.sensors.imperfections import Imperfections
from warp_scanner.sensors.sensors import Pinhole, Spinning, sensor_named


def sensor_file(folder, text):
    path = folder / "mine.toml"
    path.write_text(text)
    return path


def test_sensors_from_files(tmp_path):
    spinning = """
        kind = "spinning"
        azimuth_steps = 720
        elevations = [10, 0.5, -3]
        azimuth_range = [-90, 90]
        range_limits = [0.5, inf]
        [imperfections]
        noise = 0.01
        mixed_chance = 1
        [imperfections.class_dropout]
        wall = 0.25
        12 = 1
    """
    expected = Spinning(
        720, elevations=(10.0, 0.5, -3.0), azimuth_range=(-90.0, 90.0), range_limits=(0.5, np.inf),
        imperfections=Imperfections(noise=0.01, mixed_chance=1.0, class_dropout=((3, 0.25), (12, 1.0))),
    )  # fmt: skip
    assert sensor_named(sensor_file(tmp_path, spinning)) == expected
    pinhole = 'kind = "pinhole"\nwidth = 64\nheight = 48\nhorizontal_fov = 60'
    assert sensor_named(str(sensor_file(tmp_path, pinhole))) == Pinhole(64, 48, 60.0)
    hash(sensor_named(tmp_path / "mine.toml"))


PINHOLE = 'kind = "pinhole"\nwidth = 4\nheight = 3\n'
SPINNING = 'kind = "spinning"\nazimuth_steps = 4\nchannels = 3\nelevation_range = [-1, 1]\n'


@pytest.mark.parametrize(
    "text, words",
    [
        ("", ["kind", "None"]),
        ('kind = "radar"', ["kind", "pinhole, spinning", "radar"]),
        ("kind = [1]", ["kind", "[1]"]),
        ("width = ", ["not valid TOML"]),
        ("width = " + "1" * 5000, ["not valid TOML"]),
        ("width = " + "[" * 5000, ["not valid TOML"]),
        ('kind = "pinhole"\nwidth = 4', ["missing height"]),
        (PINHOLE + "depth = 3", ["unknown depth", "horizontal_fov"]),
        (PINHOLE.replace("4", "0"), ["width", "at least 1", "got 0"]),
        (PINHOLE.replace("4", "-4"), ["width", "at least 1", "got -4"]),
        (PINHOLE.replace("4", "4.0"), ["width", "whole number", "4.0"]),
        (PINHOLE.replace("4", "true"), ["width", "whole number", "True"]),
        (PINHOLE.replace("4", "1" + "0" * 400), ["width", "whole number"]),
        (PINHOLE.replace("4", "1000000000000"), ["rays", "1000000000000"]),
        (PINHOLE + "vertical_fov = 180", ["vertical_fov", "180"]),
        (PINHOLE + "vertical_fov = nan", ["vertical_fov", "nan"]),
        (PINHOLE + "vertical_fov = 1" + "0" * 400, ["vertical_fov", "a number"]),
        (PINHOLE + "range_limits = [-1, 4]", ["range_limits", "-1.0"]),
        (PINHOLE + "range_limits = [4, 4]", ["range_limits", "low < high"]),
        (PINHOLE + "range_limits = [nan, 4]", ["range_limits", "nan"]),
        (PINHOLE + "range_limits = 4", ["range_limits", "list of 2 numbers"]),
        (PINHOLE + "range_limits = [1, 2, 3]", ["range_limits", "list of 2 numbers"]),
        (PINHOLE + 'range_limits = [1, "x"]', ["range_limits", "a number", "'x'"]),
        (PINHOLE + "imperfections = 4", ["imperfections", "a table"]),
        (PINHOLE + "[imperfections]\nnoize = 1", ["unknown imperfections.noize", "noise_per_metre"]),
        (PINHOLE + "[imperfections]\nnoise = -1", ["imperfections.noise", "-1.0"]),
        (PINHOLE + "[imperfections]\nclass_dropout = [1]", ["imperfections.class_dropout", "a table"]),
        (PINHOLE + "[imperfections.class_dropout]\nglas = 1", ["imperfections.class_dropout", "glas", "wall"]),
        (PINHOLE + "[imperfections.class_dropout]\n300 = 1", ["imperfections.class_dropout", "0 to 255", "300"]),
        (PINHOLE + "[imperfections.class_dropout]\nwall = 2", ["imperfections.class_dropout", "got 2.0"]),
        (SPINNING.replace("steps = 4", "steps = 0"), ["azimuth_steps", "at least 1"]),
        (SPINNING + "elevations = [1]", ["either elevations", "3 channels and 1 elevations"]),
        (SPINNING.replace("channels = 3", "channels = 0"), ["either elevations", "0 channels"]),
        (SPINNING.replace("channels = 3", "channels = -3"), ["channels", "-3"]),
        (SPINNING.replace("[-1, 1]", "[1, -1]"), ["elevation_range", "1.0, -1.0"]),
        (SPINNING.replace("[-1, 1]", "[0, 0]"), ["elevation_range"]),
        (SPINNING + "azimuth_range = [0, 361]", ["azimuth_range", "361"]),
        ('kind = "spinning"\nazimuth_steps = 4\nelevations = [1, 1]', ["elevations", "fall"]),
        ('kind = "spinning"\nazimuth_steps = 4\nelevations = [1, 2]', ["elevations", "fall"]),
        ('kind = "spinning"\nazimuth_steps = 4\nelevations = [91]', ["elevations", "91"]),
        ('kind = "spinning"\nazimuth_steps = 4\nelevations = [nan]', ["elevations", "nan"]),
    ],
)
def test_bad_sensor_files_end_in_one_line_that_names_file_and_key(tmp_path, text, words):
    path = sensor_file(tmp_path, text)
    with pytest.raises(ValueError) as caught:
        sensor_named(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message
    for word in words:
        assert word in message, message


def test_unreadable_sensor_files_are_named(tmp_path):
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    for name, word in (("oak-d-por", "velodyne-16"), (tmp_path, "expected a sensor file"), ("a\0b", "expected a")):
        with pytest.raises(ValueError, match=word):
            sensor_named(name)
    with pytest.raises(ValueError, match=r"binary\.toml: cannot read the sensor: not UTF-8"):
        sensor_named(tmp_path / "binary.toml")


def test_the_example_of_the_documentation_is_one(tmp_path):
    expected = Spinning(
        2048, 32, (-22.5, 22.5), range_limits=(0.3, 90.0),
        imperfections=Imperfections(noise=0.01, class_dropout=((scenes.DOOR, 0.05),)),
    )  # fmt: skip
    assert sensor_named(sensor_file(tmp_path, sensor_files.__doc__.partition("\n\n")[2])) == expected
