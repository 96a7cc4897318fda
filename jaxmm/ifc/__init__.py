"""The text of a model in; the same with edits out, and back. May import: root, learning, deviations, verdicts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "undo": ["revert"],
        "update": ["write_update"],
    },
)
