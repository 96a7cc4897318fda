"""Settings of a detection: what a file may set, and what it may not."""

import dataclasses

import pytest

from jaxmm.config import ConfigError
from jaxmm.verdicts.placement import OF_CLOUDS
from jaxmm.verdicts.settings import DetectSettings, load_settings


def settings_of(tmp_path, text, **given):
    path = tmp_path / "settings.toml"
    path.write_text(text, encoding="utf-8")
    return load_settings(path, **given)


def test_a_file_sets_what_it_names_and_options_come_before_it(tmp_path):
    text = 'preset = "thesis"\nclasses = ["wall"]\n[verdicts]\nchange_prior = 0.1\n[cloud_limits]\nleast_overlap = 0.4'
    found = settings_of(tmp_path, text)
    assert (found.preset, found.classes, found.verdicts.change_prior) == ("thesis", ("wall",), 0.1)
    assert found.cloud_limits == dataclasses.replace(OF_CLOUDS, least_overlap=0.4)
    assert found.limits == DetectSettings().limits
    assert settings_of(tmp_path, text, preset="default").preset == "default"
    assert load_settings(None) == DetectSettings()


@pytest.mark.parametrize(
    "text, words",
    [
        ("[verdicts]\nchange_prior = 5.0", ["verdicts: change_prior", "5.0"]),
        ("[verdicts]\nchange_prior = 0.0", ["verdicts: change_prior", "0.0"]),
        ("[verdicts]\nleast_rays = -3", ["verdicts: least_rays", "at least 1", "-3"]),
        ("[verdicts]\nthreshold = nan", ["verdicts: threshold", "from 0 to 1", "nan"]),
        ("[limits]\nleast_overlap = -7.0", ["limits: least_overlap", "from 0 to 1", "-7.0"]),
        ("[cloud_limits]\nmost_residual = -0.1", ["cloud_limits: most_residual", "at least 0", "-0.1"]),
        ("[objects]\nleast_probability = 0.2", ["least_probability"]),
        ("[objects]\nleast_type = 0.8", ["least_type", "[0, 0.5]", "0.8"]),
        ("least_probability = 1.5", ["least_probability", "from 0 to 1", "1.5"]),
        ('classes = ["roof"]', ["classes", "roof"]),
        ('preset = "none"', ["preset", "none"]),
    ],
)
def test_values_out_of_range_are_refused_in_one_line(tmp_path, text, words):
    with pytest.raises(ConfigError) as error:
        settings_of(tmp_path, text)
    said = str(error.value)
    assert "settings.toml" in said and "\n" not in said and all(word in said for word in words), said
