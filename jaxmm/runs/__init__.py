"""A config in, a run folder with its table out. Imports every room but ifc and commands."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "main_job": ["evaluate", "reproduce"],
        "room_scans": ["room_cases"],
        "training_stage": ["train"],
    },
)
