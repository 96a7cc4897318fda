"""Data sets are the same bits on processors of other instruction sets: AVX2 alone beside AVX-512."""

import os
import subprocess
import sys

import pytest

from jaxmm.caches import TREE as ROOT
from jaxmm.files import sha256_of
from jaxmm.versions import instructions

WIDE = ("X86_V4", "AVX512_ICL", "AVX512_SPR")
# What Python runs at its start, in workers too: Warp then compiles for a processor that knows AVX2 and no more.
NARROW = """
import warp
flags = warp.config.cpu_compiler_flags
assert "-march=native" in flags
warp.config.cpu_compiler_flags = flags.replace("-march=native", "-target-cpu x86-64-v3")
"""


@pytest.mark.long
@pytest.mark.skipif("X86_V4" not in instructions(), reason="this processor has no AVX-512 to be compared with AVX2")
def test_shards_are_the_same_bits_with_avx2_as_with_avx512(tmp_path):
    (tmp_path / "narrow").mkdir()
    (tmp_path / "narrow" / "sitecustomize.py").write_text(NARROW)
    narrow = {
        "NPY_DISABLE_CPU_FEATURES": " ".join(set(WIDE) & set(instructions())),
        "OPENBLAS_CORETYPE": "Haswell",
        "XLA_FLAGS": "--xla_cpu_max_isa=AVX2",
        "WARP_CACHE_PATH": str(tmp_path / "kernels"),
        "PYTHONPATH": os.pathsep.join((str(tmp_path / "narrow"), str(ROOT))),
    }
    digests = []
    for name, environment in (("wide", {"PYTHONPATH": str(ROOT)}), ("narrow", narrow)):
        out = tmp_path / name / "shards"
        arguments = ["generate", ROOT / "configs" / "generate.toml", "--count", "12", "--out", out]
        command = [sys.executable, "-m", "jaxmm", *map(str, arguments)]
        done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        digests.append([sha256_of(path) for path in sorted((out / "shards").iterdir())])
        told = (out / "versions.json").read_text()
        assert ("X86_V4" in told) == (name == "wide")  # the limit was one
    assert digests[0] and digests[0] == digests[1]
