"""Detections or scores in; files out. May import: root, formats, rays, learning, deviations, classes, verdicts."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "bcf": ["write_bcf"],
        "detection_figures": ["write_figures"],
        "markdown": ["as_markdown"],
        "page": ["write_page"],
        "plain_files": ["write_plain"],
        "report_json": ["to_json"],
    },
)
