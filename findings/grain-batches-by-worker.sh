#!/usr/bin/env bash
# Grain puts other elements together in a batch when the number of workers changes.
#
# Library: grain 0.2.18 (PyPI).
# A good guess: the DataLoader's order is fixed by sampler and seed, and workers change only the speed. Without batches
#   this is so: they take turns, and their elements come back in order.
# What happens: each worker batches what it draws itself, so a batch of two from two workers holds elements 0 and 2, not
#   0 and 1. Where the number of workers follows the cores, the same seed trains another network on another machine.
# Seen:
#   grain 0.2.18
#   expected: the same order from any number of workers
#   seen:     0 workers, no batches: [0, 1, 2, 3, 4, 5, 6, 7]
#   seen:     2 workers, no batches: [0, 1, 2, 3, 4, 5, 6, 7]
#   seen:     0 workers, batches of 2: [[0, 1], [2, 3], [4, 5], [6, 7]]
#   seen:     2 workers, batches of 2: [[0, 2], [1, 3], [4, 6], [5, 7]]
# In jaxmm: a batch is drawn as a whole by its step's number, in one thread, so no count of workers enters.
set -euo pipefail
VERSION=${VERSION:-0.2.18}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
"${PYTHON:-python3}" -m venv env
env/bin/pip install -qq --disable-pip-version-check "grain==$VERSION" numpy==2.4.6
cat > check.py <<'PY'
import os
import sys
from importlib.metadata import version

import grain
import numpy as np
from absl import app


def order(workers: int, batched: bool) -> list:
    sampler = grain.samplers.IndexSampler(8, num_epochs=1, shuffle=False, seed=0)
    operations = [grain.transforms.Batch(2)] if batched else []
    loader = grain.DataLoader(
        data_source=list(range(8)), sampler=sampler, operations=operations, worker_count=workers
    )
    return [np.asarray(element).tolist() for element in loader]


def main(_) -> None:
    print("grain", version("grain"))
    print("expected: the same order from any number of workers")
    seen = {(workers, batched): order(workers, batched) for batched in (False, True) for workers in (0, 2)}
    for (workers, batched), found in seen.items():
        print(f"seen:     {workers} workers, {'batches of 2' if batched else 'no batches'}: {found}")
    stated = (
        seen[0, False] == seen[2, False] == list(range(8))
        and seen[0, True] == [[0, 1], [2, 3], [4, 5], [6, 7]]
        and seen[2, True] == [[0, 2], [1, 3], [4, 6], [5, 7]]
    )
    print("as stated" if stated else "NO LONGER AS STATED", flush=True)
    os._exit(0 if stated else 3)  # its threads complain when the interpreter ends


if __name__ == "__main__":
    app.run(main)
PY
env/bin/python check.py 2> said || {
    status=$?
    tail -n 5 said >&2
    exit "$status"
}
