"""Progress of long work, on standard error."""

import sys
from collections.abc import Iterable, Iterator

from tqdm import tqdm


def progress(items: Iterable, label: str, total: int) -> Iterator:
    """The items, one room each, with a bar that counts them."""
    with bar_of(label, total, "room") as bar:
        for item in items:
            yield item
            bar.update()


def bar_of(label: str, total: int, unit: str, done: int = 0, *, is_long: bool = True) -> tqdm:
    """A progress bar with the time that remains; none where standard error is no terminal, but a line of long work."""
    if is_long and not sys.stderr.isatty():
        print(label, file=sys.stderr)
    return tqdm(total=total, initial=done, desc=label, unit=unit, disable=None, dynamic_ncols=True, file=sys.stderr)
