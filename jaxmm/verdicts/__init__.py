"""A prior and rays in; a Detection out. May import: root, formats, rays, learning, objects, deviations, classes."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "detection": ["NamedScan", "detect_scans"],
        "priors": ["Prior", "prior_of_building", "prior_of_cloud", "read_prior"],
        "results": ["Detection", "Mismatch"],
        "settings": ["DetectSettings", "load_settings"],
    },
)
