"""What one robot scan says about a building model: added, removed, or simply not seen."""

import os

import lazy_loader

from warp_scanner.caches import cache_folder

# JAX reads this when it is first imported, so it must stand before any other import of the package.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_folder("jax")))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.5")

# What users call, found when it is asked for: it loads JAX and Warp. Each room names some more.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "commands.detect_files": ["detect", "write_all"],
        "commands.scanning": ["scan"],
        "data.generation": ["Request", "generate"],
        "data.simulator_settings": ["load_config"],
        "formats.poses": ["parse_pose", "read_poses"],
        "formats.readers": ["read_scans"],
        "formats.writers": ["write_scan"],
        "ifc.undo": ["revert"],
        "inputs": ["InputError"],
        "runs.main_job": ["evaluate", "reproduce"],
        "runs.training_stage": ["train"],
        "stations.named_files": ["Reading"],
        "stations.work_folder": ["Work"],
        "verdicts.priors": ["read_prior"],
        "verdicts.results": ["Detection"],
        "verdicts.settings": ["DetectSettings"],
    },
)
