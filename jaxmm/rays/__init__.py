"""Points and poses in; rays, evidence and registration out. May import: root."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "evidence": ["FRACTIONS", "features_of", "fractions"],
        "registration": ["register"],
        "rule": ["rule_scores"],
        "scan_rays": ["PosedScan", "rays_of_scan"],
        "viewpoint": ["estimate"],
    },
)
