"""Scenes, poses and sensors in; ranges out. May import: root, scenes, kernels."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "imperfections": ["Imperfections"],
        "poses": ["Pose", "rotation_of"],
        "scan": ["Rays", "Scan", "cast_rays"],
        "sensors": ["OAK_D_PRO", "Pinhole", "Spinning", "sensor_named"],
        "triangles": ["cast_triangles", "prepare"],
    },
)
