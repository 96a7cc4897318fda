"""Rays in; how far off its place in the model each element stands out. May import: root, rays."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={"deviation": ["Deviation", "deviations_of"], "tolerances": ["DeviationSettings"]},
)
