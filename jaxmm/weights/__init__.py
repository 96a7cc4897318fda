"""The trained default models, which every command uses that is not given others."""

from pathlib import Path

DEFAULT = Path(__file__).with_name("default.safetensors")
OBJECTS = Path(__file__).with_name("objects.safetensors")  # the judge of objects
