"""What the bits of a run depend on: versions of packages, of the machine and of our own code."""

import hashlib
import importlib.metadata
import platform
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.caches import TREE
from warp_scanner.cores import core_count

PACKAGES = (
    "jaxmm",
    "flax",
    "jax",
    "jaxlib",
    "numpy",
    "optax",
    "orbax-checkpoint",
    "safetensors",
    "scikit-learn",
    "scipy",
    "small-gicp",
    "warp-lang",
)

TOLD = ("git_commit", "processor", "instructions")  # of versions(): for readers; a run may go on where they are others


def versions() -> dict[str, Any]:
    """What the bits of a run depend on, and TOLD."""
    return {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "processor": processor(),
        "instructions": instructions(),
        "threads": core_count(),
        "packages": {name: importlib.metadata.version(name) for name in PACKAGES},
        "code": _code_hash(),
        "git_commit": _git_commit(),
    }


def processor() -> str:
    """What this machine's processor calls itself; empty where nothing tells."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def instructions() -> list[str]:
    """Sets of vector instructions that NumPy finds here, such as X86_V3 (with AVX2) and X86_V4 (with AVX-512)."""
    found = np.show_config(mode="dicts")["SIMD Extensions"]
    return [*found["baseline"], *found.get("found", [])]


def _code_hash() -> str:
    """sha256 over the sources of both packages; unlike the commit it tells code from prose."""
    digest = hashlib.sha256()
    for path in sorted(path for name in ("jaxmm", "warp_scanner") for path in (TREE / name).rglob("*.py")):
        digest.update(path.relative_to(TREE).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _git_commit() -> str | None:
    """Commit of the source tree, `+` when it has changes, None outside a checkout."""
    if not (TREE / ".git").exists():
        return None
    try:
        commit, changes = (
            subprocess.run(["git", "-C", str(TREE), *words], capture_output=True, text=True, check=True).stdout.strip()
            for words in (["rev-parse", "HEAD"], ["status", "--porcelain", "--untracked-files=no"])
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return commit + ("+" if changes else "")
