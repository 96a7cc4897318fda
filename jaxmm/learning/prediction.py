"""Runs the four models over both sides of a scan. N points of one side."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.config import NetworkConfig
from jaxmm.inputs import InputError
from jaxmm.learning.inference import predict
from jaxmm.learning.model import Model, pick_model
from jaxmm.learning.model_files import load_models
from jaxmm.rays.evidence import Frame, View, features_of

EVIDENCE = "evidence"


class Judges(NamedTuple):
    """The four models of one method, with the widths of their network."""

    models: Model
    network: NetworkConfig


def read_judges(model: Path) -> Judges:
    """The four models of a run folder or .safetensors file.

    Raises:
        InputError: it holds no models that judge evidence.
    """
    models, trained = load_models(model)
    if EVIDENCE not in models:
        raise InputError(f"--model: {model}: expected models of the method {EVIDENCE}, found {', '.join(models)}")
    return Judges(models[EVIDENCE], trained.network)


class Side(NamedTuple):
    """One side of one scan, with what the models say of it."""

    view: View
    pillar: np.ndarray  # (N,) float32 probability of belonging to a changed pillar
    wall: np.ndarray  # (N,) float32

    @property
    def probability(self) -> np.ndarray:
        """(N,) float32, the greater of both: a wall seen end-on looks like a pillar."""
        return np.maximum(self.pillar, self.wall)

    @property
    def evidence(self) -> np.ndarray:
        """(N,) uint8 index into evidence.FRACTIONS of what most rays of each point did; unseen without any."""
        return np.where(self.view.count.any(axis=1), self.view.count.argmax(axis=1), 3).astype(np.uint8)


def unjudged(view: View) -> Side:
    """A view of which no model was asked: nothing is said to have changed."""
    return Side(view, *np.zeros((2, len(view.points)), np.float32))


def judge(judges: Judges, view: View, frame: Frame, change: str) -> Side:
    """What the models for `change` ("added" or "removed") say of a view."""
    if not len(view.points):
        return unjudged(view)
    features = features_of(view, frame)
    pillar, wall = (
        predict(pick_model(judges.models, f"{kind}_{change}"), features, judges.network) for kind in ("pillar", "wall")
    )
    return Side(view, pillar, wall)
