"""How many cores there are for this process. Imports no Warp: processes that only share work out ask, too."""

import os


def core_count() -> int:
    """Cores that this process may run on, at least 1: on a cluster's machine a job has but a part of them.

    As `os.process_cpu_count` of Python 3.13. Where a system does not tell, as macOS, all cores of the machine.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
