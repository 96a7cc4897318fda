"""Probable points in, walls and columns out. Imports the root and learning."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "finder": ["Judged", "ObjectSettings", "find_objects"],
    },
)
