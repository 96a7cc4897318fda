"""Words in, the rest out. May import: root, formats, learning, data, stations, verdicts, ifc, reports, thesis, runs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "detect_files": ["detect", "write_all"],
        "scanning": ["scan"],
    },
)
