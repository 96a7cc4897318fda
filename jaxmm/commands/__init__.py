"""Words. May import: root, formats, learning, data, stations, verdicts, ifc, reports, weeks, thesis, runs, exchange."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "detect_files": ["detect", "write_all"],
        "scanning": ["scan"],
    },
)
