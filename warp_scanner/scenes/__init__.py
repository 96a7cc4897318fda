"""What can be scanned: tables of primitives, and buildings of triangles. May import: nothing."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "building": ["Building", "ReadOptions"],
        "scenes": ["Primitives"],
    },
)
