"""Building files in; buildings and pairs of their scans out. May import: root, scenes, sensors, rooms."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "files": ["read_building"],
        "pairs": ["BuildingPairConfig", "make_building_pairs"],
        "room_ifc": ["write_room"],
    },
)
