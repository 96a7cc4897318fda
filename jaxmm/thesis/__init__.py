"""The thesis's public repository in; its tables out. May import: root, rays, learning."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "repository": ["find_pairs", "read_pair"],
        "rows": ["score_repository"],
    },
)
