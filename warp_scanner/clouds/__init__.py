"""Ranges in; points, their neighbours, voxels and planes out. May import: root, kernels, sensors."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "neighbours": ["nearest"],
        "points": ["points_of"],
        "voxels": ["thin_clouds"],
    },
)
