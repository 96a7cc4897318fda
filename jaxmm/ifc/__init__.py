"""A model's text in, the same with edits out, and back. Imports the root, learning and verdicts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "undo": ["revert"],
        "update": ["write_update"],
    },
)
