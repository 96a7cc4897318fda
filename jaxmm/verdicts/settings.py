"""How to detect: the settings of `jaxmm detect`, with their defaults; a TOML file may set any of them."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.classes.lacking import check_asked
from jaxmm.classes.selection import USUAL, check_classes, chosen, is_chosen
from jaxmm.classes.unexplained import UnexplainedSettings
from jaxmm.config import bounded, build, one_of, read_toml
from jaxmm.deviations.tolerances import DeviationSettings
from jaxmm.learning.boxes import BoxSettings
from jaxmm.objects.finder import ObjectSettings
from jaxmm.verdicts.placement import OF_CLOUDS, FitLimits
from jaxmm.verdicts.verdicts import VerdictSettings
from warp_scanner.scenes.building import Building, Elements

PRESETS = ("default", "thesis")


@dataclasses.dataclass(frozen=True)
class DetectSettings:
    """How to detect."""

    preset: str = one_of("default", *PRESETS)  # thesis: its boxes of whatever its four models yield, `objects` unused
    least_probability: float = bounded(0.5, 0.0, 1.0)  # of a mismatch, to be reported
    classes: tuple[str, ...] = USUAL  # whose elements get a verdict: all, ours, or of IFC
    settle: bool = True  # of scans whose ranges err; the thesis's preset takes every scan as it is
    mirrors: bool = True  # leaves out what mirrors and panes show of the room in front; the thesis's preset never does
    refine: bool = True  # registers every scan before anything is concluded from it
    propose_views: bool = True  # a place to look from next for every occluded element
    objects: ObjectSettings = ObjectSettings()  # how the default preset makes objects of points
    boxes: BoxSettings = BoxSettings()  # how the thesis does
    unexplained: UnexplainedSettings = UnexplainedSettings()  # what else counts as something that the model lacks
    verdicts: VerdictSettings = VerdictSettings()
    deviations: DeviationSettings = DeviationSettings()  # how far off its place an element may stand
    limits: FitLimits = FitLimits()  # of a building as prior
    cloud_limits: FitLimits = OF_CLOUDS  # of a point cloud as prior

    def __post_init__(self):
        check_classes(self.classes)
        if self.preset not in PRESETS:
            raise ValueError(f"preset must be one of {', '.join(PRESETS)}, got {self.preset!r}")

    def asked(self, elements: Elements) -> np.ndarray:
        """(E,) bool: the elements that get a verdict."""
        return chosen(self.classes, elements)

    def asks_for(self, ifc_class: str, semantic: int) -> bool:
        """Whether elements of a class of IFC, and of what the scanner calls it, get a verdict."""
        return is_chosen(self.classes, ifc_class, semantic)

    def check_asked(self, building: Building) -> None:
        """Refuse to look for what a building has no element of.

        Raises:
            InputError: no class that was asked for has any; the usual ones nobody has to ask for.
        """
        check_asked(self.classes, building)

    def as_json(self) -> dict[str, Any]:
        """All that had a say, by name."""
        told = dataclasses.asdict(self)
        del told["objects" if self.preset == "thesis" else "boxes"]
        return told | {"change_prior": self.verdicts.change_prior}


def load_settings(path: Path | None, **given: Any) -> DetectSettings:
    """Settings from a TOML file, if there is one, with those that were given in its place.

    Raises:
        ConfigError: the file is missing or no TOML, or a setting is unknown, of the wrong type, or out of range.
    """
    values = {} if path is None else read_toml(path)
    return build(DetectSettings, values | given, str(path or "settings"))
