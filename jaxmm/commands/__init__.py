"""Words into calls. May import: root, formats, rays, learning, data, verdicts, ifc, reports, thesis, runs, exchange."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "detect_files": ["Reading", "detect", "write_all"],
        "scanning": ["scan"],
    },
)
