"""Reports of weeks in; what became of each element out. May import: root, formats, learning, ifc, reports, verdicts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "history": ["Progress", "follow"],
        "outputs": ["write_progress"],
        "reports": ["read_weeks"],
    },
)
