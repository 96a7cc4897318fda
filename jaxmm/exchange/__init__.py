"""Pairs in; plain files for others, and scores, out. May import: root, formats, rays, learning, verdicts, runs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "export": ["Request", "export"],
        "scene_files": ["read_scene", "read_truth"],
        "scores": ["score"],
        "tasks": ["ExportSettings"],
    },
)
