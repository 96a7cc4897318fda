"""Many scans in, what each says out. May import: root, formats, rays, learning, data, objects, deviations, classes,
verdicts.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, submod_attrs={"named_files": ["Reading"], "work_folder": ["Work"]}
)
