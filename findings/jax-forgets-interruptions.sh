#!/usr/bin/env bash
# A Ctrl-C that comes while JAX looks after its memory is printed and forgotten: the program goes on.
#
# Library: jax 0.10.2, jaxlib 0.10.2 (PyPI: jax).
# A good guess: Ctrl-C ends a program of plain Python code with KeyboardInterrupt, whatever it has imported.
# What happens: importing JAX hangs a callback of its own into Python's garbage collector. A signal that comes during a
#   collection is handed to the next Python code that runs, which is that callback; Python prints what a callback
#   raises as "Exception ignored in", and goes on. The more a program makes and forgets, the more of its signals are
#   lost; without JAX there is no such callback, and none is.
# Seen:
#   jax 0.10.2
#   2,000 interruptions each, of a loop that makes and forgets lists
#   expected: each is raised where the loop can catch it, with JAX imported as without
#   seen without JAX: forgotten 0
#   seen with JAX:    forgotten more than 20, all in _xla_gc_callback
# In jaxmm: the hook for exceptions that nobody hears raises a forgotten interruption again a moment later.
set -euo pipefail
VERSION=${VERSION:-0.10.2}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "jax==$VERSION" "jaxlib==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import random
import signal
import sys

with_jax = sys.argv[1] == "with"
if with_jax:
    import jax  # noqa: F401  (only imported)
    import numpy  # noqa: F401

signal.signal(signal.SIGALRM, signal.default_int_handler)
random.seed(0)
lost = []
sys.unraisablehook = lambda what: lost.append(getattr(what.object, "__name__", "?"))
caught, tries = 0, 2000
for _ in range(tries):
    before = len(lost)
    try:
        signal.setitimer(signal.ITIMER_REAL, random.uniform(0.0005, 0.003))
        while len(lost) == before:
            for _ in range(300):
                ring = []
                ring.append(ring)
    except KeyboardInterrupt:
        caught += 1
print(tries, caught, len(lost), ",".join(sorted(set(lost))) or "-")
PY
echo "jax $VERSION"
echo "2,000 interruptions each, of a loop that makes and forgets lists"
echo "expected: each is raised where the loop can catch it, with JAX imported as without"
read -r tries caught lost where < <(env/bin/python check.py without)
read -r _ caught_jax lost_jax where_jax < <(JAX_PLATFORMS=cpu env/bin/python check.py with)
echo "seen without JAX: forgotten $lost"
echo "seen with JAX:    forgotten $lost_jax, in $where_jax"
if [ "$lost" = 0 ] && [ "$caught" = "$tries" ] && [ "$lost_jax" -gt 20 ] && [ "$where_jax" = _xla_gc_callback ]; then
    echo "as stated"
else
    echo "NO LONGER AS STATED"
    exit 3
fi
