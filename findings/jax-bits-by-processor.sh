#!/usr/bin/env bash
# The same jitted product and the same rsqrt give other bits on a processor with AVX-512 than on one with AVX2 alone.
#
# Library: jax 0.10.2 on the CPU (PyPI); the other processor is emulated by qemu-user 7.2 (Debian 12).
# A good guess: what a CPU program of one version of XLA computes hangs on the program, at most on the number of
#   threads; and --xla_cpu_max_isa=AVX2 shows what an older processor would give.
# What happens: products run in YNNPACK, which picks its kernels at run time by what the processor says of itself, not
#   by that flag. Sums of up to 512 products are equal, longer ones are not. rsqrt starts from the processor's estimate.
#   The flag limits only what XLA itself compiles, so a test under it passes while another machine differs.
#   With xla_cpu_enable_platform_dependent_math off they are equal, but for products that YNNPACK does not take, such as
#   those that contract the first operand's rows, which gradients of kernels are. These run in Eigen, which seems to split
#   their sums by the size of the processor's caches. With that operand transposed behind an optimization_barrier YNNPACK
#   takes them.
# Seen:
#   jax 0.10.2 here (X86_V4) and on an emulated Haswell
#   expected: the same bits everywhere, or other ones under the flag as well
#   seen:      as it comes: 512: same; 1024: other bits; rsqrt: other bits; rows: other bits; turned: other bits
#              here, --xla_cpu_max_isa=AVX2: 512: same; 1024: same; rsqrt: same; rows: same; turned: same
#              platform_dependent_math off: 512: same; 1024: same; rsqrt: same; rows: other bits; turned: same
# In jaxmm: training and evaluation are compiled with that option, products of gradients have their operand turned, and
#   short sums an order of their own: with as many threads trained weights are the same bits
#   (tests/learning/test_same_anywhere.py).
set -euo pipefail
VERSION=${VERSION:-0.10.2}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "jax==$VERSION" "jaxlib==$VERSION" numpy==2.4.6
apt-get download -qq qemu-user-static 2> /dev/null
dpkg -x qemu-user-static_*.deb qemu
cat > compute.py <<'PY'
import hashlib
import sys

import jax
import jax.numpy as jnp
import numpy as np

rng = np.random.default_rng(0)
options = {"xla_cpu_enable_platform_dependent_math": False} if sys.argv[1] == "off" else {}


def bits(function, *arrays):
    return hashlib.sha256(np.asarray(jax.jit(function, compiler_options=options)(*arrays)).tobytes()).hexdigest()


for count in (512, 1024):
    left, right = (rng.normal(size=shape).astype(np.float32) for shape in ((64, count), (count, 64)))
    print(f"{count}:", bits(lambda a, b: a @ b, left, right))
print("rsqrt:", bits(jax.lax.rsqrt, rng.uniform(0.1, 9.0, 4096).astype(np.float32)))
left, right = (rng.normal(size=(2, 4096, width)).astype(np.float32) for width in (128, 256))
print("rows:", bits(lambda a, b: jnp.einsum("bnc,bnd->bcd", a, b), left, right))
print("turned:", bits(lambda a, b: jax.lax.optimization_barrier(jnp.swapaxes(a, 1, 2)) @ b, left, right))
PY
cat > check.py <<'PY'
import os
import subprocess
import sys

import jax
import numpy as np

if "X86_V4" not in np.show_config(mode="dicts")["SIMD Extensions"]["found"]:
    sys.exit("cannot be shown here: needs a processor with AVX-512")
HASWELL = ["qemu/usr/bin/qemu-x86_64-static", "-cpu", "Haswell-noTSX"]


def computed(given: str, before: list[str], flags: str = "") -> list[str]:
    command = [*before, sys.executable, "compute.py", given]
    return subprocess.run(
        command, capture_output=True, text=True, check=True, env=os.environ | {"XLA_FLAGS": flags}
    ).stdout.splitlines()


print("jax", jax.__version__, "here (X86_V4) and on an emulated Haswell")
print("expected: the same bits everywhere, or other ones under the flag as well")
here, steady = computed("on", []), computed("off", [])
found = {
    "as it comes": (here, computed("on", HASWELL)),
    "here, --xla_cpu_max_isa=AVX2": (here, computed("on", [], "--xla_cpu_max_isa=AVX2")),
    "platform_dependent_math off": (steady, computed("off", HASWELL)),
}
STATED = {
    "as it comes": [True, False, False, False, False],
    "here, --xla_cpu_max_isa=AVX2": [True] * 5,
    "platform_dependent_math off": [True, True, True, False, True],
}
stated = True
for number, (name, (one, other)) in enumerate(found.items()):
    same = [a == b for a, b in zip(one, other, strict=True)]
    stated &= same == STATED[name]
    names = [line.partition(":")[0] for line in one]
    told = "; ".join(f"{what}: {'same' if equal else 'other bits'}" for what, equal in zip(names, same, strict=True))
    print("          " if number else "seen:     ", name + ":", told)
print("as stated" if stated else "NO LONGER AS STATED")
sys.exit(0 if stated else 3)
PY
env/bin/python check.py
