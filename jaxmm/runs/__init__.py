"""A config in; a run folder out. May import: root, rays, learning, data, objects, verdicts, reports, thesis."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "main_job": ["evaluate", "reproduce"],
        "room_scans": ["room_cases"],
        "training_stage": ["train"],
    },
)
