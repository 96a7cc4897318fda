"""The content of report.json, of a Detection."""

import math
from typing import Any

import numpy as np

from jaxmm.deviations.deviation import PRIVATE
from jaxmm.rays.evidence import FRACTIONS
from jaxmm.verdicts.results import FORMAT, Detection, ElementVerdict, Mismatch, PriorFile, ScanRecord, told_probability


def to_json(detection: Detection) -> dict[str, Any]:
    """The content of report.json; valid against report_schema.json. Numbers that are not finite become null."""
    return {
        "format": FORMAT,
        "date": detection.date,
        "mismatches": [_mismatch(one) for one in detection.mismatches],
        "elements": [_element(one) for one in detection.elements],
        "unexplained": [_plain(one._asdict()) for one in detection.unexplained],
        "prior": _prior(detection.prior),
        "scans": [_scan(one) for one in detection.scans],
        "sentences": list(detection.sentences),
        "registration": _plain(detection.registration),
        "settings": _plain(detection.settings),
        "timing": _plain({name: round(value, 4) for name, value in detection.timing.items()}),
        "notes": list(detection.notes),
    }


def _mismatch(one: Mismatch) -> dict[str, Any]:
    told = one._asdict() | {"probability": told_probability(one.probability)}
    if one.type_probability is not None:
        told["type_probability"] = told_probability(one.type_probability)
    del told["told_by"], told["standing"], told["shaft"], told["pieces"]
    return _plain(told)


def _element(one: ElementVerdict) -> dict[str, Any]:
    evidence = {"points": one.points} | dict(zip(FRACTIONS, one.rays, strict=True))
    told = one._asdict()
    del told["points"], told["rays"]
    for name in ("same_as", "parts", "parts_gone", "part_of"):
        told[name] = [{"file": file, "guid": guid} for file, guid in told[name]]
    if one.deviation is not None:
        deviation = one.deviation._asdict()
        for private in PRIVATE:
            del deviation[private]
        told["deviation"] = deviation
    if one.box is not None:
        told["box"] = one.box._asdict()
    return _plain(told | {"evidence": evidence, "probability": told_probability(one.probability)})


def _prior(one: PriorFile | None) -> dict[str, Any] | None:
    """A unit as it is: a foot has more digits than a micrometre."""
    if one is None:
        return None
    told = one._asdict()
    del told["sources"]
    files = [
        {name: getattr(source, name) for name in ("file", "kind", "unit", "project", "elements")}
        | {"to_world": source.to_world.tolist()}
        for source in one.sources
    ]
    return told | {"files": files}


def _scan(one: ScanRecord) -> dict[str, Any]:
    taken = None if one.taken is None else one.taken._asdict()
    return _plain(one._asdict() | {"doubted": one.doubted, "taken": taken})


def _plain(value: Any) -> Any:
    """NumPy and tuples to what JSON knows; micrometres are enough of any length."""
    if isinstance(value, dict):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(one) for one in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return round(float(value), 6) if math.isfinite(value) else None
    return value
