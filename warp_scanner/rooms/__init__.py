"""A seed in; random rooms, what changes in them, and pairs of scans out. May import: root, scenes, kernels, sensors."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "pairs": ["PairConfig", "make_pairs"],
        "rooms": ["RoomConfig", "make_rooms"],
        "standing": ["Standing"],
    },
)
