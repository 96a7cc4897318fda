"""Settings in; pairs of scans, labelled clouds and data sets out. May import: root, rays, learning."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "generation": ["Request", "generate"],
        "labelled_rooms": ["clouds"],
        "simulator_settings": ["load_config", "pair_config"],
    },
)
