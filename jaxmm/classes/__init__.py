"""Elements of any class in; what glass and parts tell, and what no model has. May import: root, rays, learning."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "unexplained": ["Unexplained", "unexplained_things"],
    },
)
