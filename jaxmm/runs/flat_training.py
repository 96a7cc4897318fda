"""Trains the judge of objects further, on candidates of small, low and crowded flats among those of rooms.

    python -m jaxmm.runs.flat_training --judge FILE --out FILE [--band 2] [--flats N] [--rooms N] [--draws DIR]

K candidates, F clues. The judge has learnt from rooms (`object_training`), of which few are low and none is crowded.
MORE rounds of trees, which count in rooms of one band of heights alone (judge.LOW), are grown on what it is still wrong
about in low rooms of any band: candidates of flats, where walls are short and things stand close before them, of rooms
as the judge learnt from, but low, and of flats in which cupboards reach up to the ceiling: without those, all that does
so would be a wall. There are more rooms than flats, or what was right in low rooms would be lost. A tenth of each is
kept from training, to say how well it does.
"""

import argparse
import json
from functools import partial
from pathlib import Path

import numpy as np
import safetensors

from jaxmm.inputs import InputError
from jaxmm.learning.boxes import Box
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.learning.upright_shapes import outside
from jaxmm.objects.finder import ObjectSettings, examine
from jaxmm.objects.judge import KINDS, LOW, band_of, height_of, load_judge, save_judge
from jaxmm.progress import bar_of
from jaxmm.rays.range_noise import settled
from jaxmm.rays.scan_rays import rays_of_scan
from jaxmm.runs.flat_scans import FlatCase, flat_case
from jaxmm.runs.object_training import (
    AT_ONCE,
    KEPT,
    WITHIN,
    Examples,
    draws_name,
    examples_of_rooms,
    fit,
    joined,
    kept_examples,
    mixed,
    plain,
    told_of,
)
from jaxmm.verdicts.scan_fusion import judged_side
from jaxmm.verdicts.station_steps import look_at
from jaxmm.weights import DEFAULT
from warp_scanner.cores import worker_pool

SEED = 5  # of the flats: of no other training, validation or test
BUILT_IN_SEED = 6  # of those with cupboards up to the ceiling
MORE = 200  # rounds; chosen on validation rooms and flats
LEARNT = 2.85  # [m] from floor to ceiling, up to which there is something to learn; heights are measured
MIXED_EVERY = 4  # draws of low rooms, of which one is of all kinds, about as many as the judge learnt from
LOW_ROOM = {"size": (20.0, 20.0, LEARNT), "size_spread": (17.0, 17.0, LEARNT - LOW[0])}  # [m], else as `varied`


def examples_of_flat(case: FlatCase, judges: Judges) -> Examples:
    """The candidates of one flat."""
    try:
        looked = look_at(case.prior, rays_of_scan(settled(case.scan).scan), judges, ("added",))[0]
    except InputError:  # hardly anything of the model in view
        return joined([])
    judged = judged_side([looked], "added")
    if not len(judged.points):
        return joined([])
    examined = examine(judged, ObjectSettings(), case.prior.known)
    kind = [kind_among(examined.sight.points[one.members], case.lacking) for one in examined.candidates]
    return Examples(examined.clues, np.array(kind, np.int64))


def kind_among(points: np.ndarray, truth: list[Box]) -> int:
    """Index into KINDS of the type that most of the points (n, 3) are of: stretches of one wall count together."""
    share = [0.5]
    for kind in KINDS[1:]:
        off = [_off(points, box) for box in truth if box.object_type == kind]
        share.append(float(np.mean(np.min(off, axis=0) <= WITHIN)) if off else 0.0)
    return int(np.argmax(share))


def _off(points: np.ndarray, box: Box) -> np.ndarray:
    """(n,) [m] that points are outside of a box, in plan."""
    turn = np.radians(box.rotation)
    return outside(points[:, :2], box.center[:2], box.dimensions[:2], np.array([np.cos(turn), np.sin(turn)]))


def flats_of_draw(number: int) -> Examples:
    """The candidates of AT_ONCE flats."""
    judges, first = read_judges(DEFAULT), number * AT_ONCE
    return joined([examples_of_flat(flat_case(SEED, first + one), judges) for one in range(AT_ONCE)])


def low_rooms_of_draw(number: int) -> Examples:
    """The candidates of as many rooms as those that the judge learnt from, but low."""
    rng = np.random.default_rng((SEED, number))
    draw = plain(rng) if number % MIXED_EVERY else mixed(rng)
    return examples_of_rooms(
        draw._replace(changed=draw.changed | {"room": draw.changed["room"] | LOW_ROOM}), SEED, number
    )


def built_in_of_draw(number: int) -> Examples:
    """The candidates of AT_ONCE flats with cupboards up to the ceiling."""
    judges, first = read_judges(DEFAULT), number * AT_ONCE
    cases = (flat_case(BUILT_IN_SEED, first + one, built_in=True) for one in range(AT_ONCE))
    return joined([examples_of_flat(case, judges) for case in cases])


MAKERS = {"flats": flats_of_draw, "rooms": low_rooms_of_draw, "built_in": built_in_of_draw}


def kept_scenes(folder: Path | None, kind: str, number: int) -> Examples:
    """Those of a draw of one of MAKERS, kept in a folder; None: in none."""
    # The heights are in the name: a folder may hold draws of lower ones.
    return kept_examples(folder and folder / f"{kind}-{LEARNT:g}m-{number:06d}.npz", MAKERS[kind], number)


def low_ones(examples: Examples) -> Examples:
    """Those in rooms up to LEARNT: further rounds learn from them."""
    return Examples(*(field[height_of(examples.clues) <= LEARNT] for field in examples))


def main(judge: Path, out: Path, band: int, counts: dict[str, int], kept_in: Path | None = None) -> None:
    """Make so many scenes of each of MAKERS, train further, save, and print how it does on those that were kept out.

    Told is of those in rooms of the band.
    """
    onto = load_judge(judge)
    with safetensors.safe_open(judge, framework="numpy") as file:
        metadata = file.metadata()
    folder = kept_in and kept_in / draws_name()
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
    draws: dict[str, list[Examples]] = {}
    with worker_pool() as pool, bar_of("flats and low rooms", sum(counts.values()), "scene") as bar:
        for kind, count in counts.items():
            draws[kind] = []
            for made in pool.map(partial(kept_scenes, folder, kind), range(count // AT_ONCE)):
                draws[kind].append(low_ones(made))
                bar.update(AT_ONCE)
    learnt = [draw for each in draws.values() for number, draw in enumerate(each) if number % KEPT]
    grown, told = fit(joined(learnt), onto, MORE, band), {}
    for kind, each in draws.items():
        kept = joined(each[::KEPT])
        kept = Examples(*(field[band_of(kept.clues) == band] for field in kept))
        if len(kept.kind):  # the lowest rooms are higher than the first band
            told |= {kind: told_of(grown, kept), f"{kind} before": told_of(onto, kept)}
    save_judge(grown, out, metadata | {f"band_{band}": json.dumps(counts | {"kept": told})})
    print(json.dumps(told))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--judge", type=Path, required=True, metavar="FILE")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE")
    parser.add_argument("--band", type=int, choices=range(1, len(LOW) + 1), default=2, help="1: the lowest rooms")
    parser.add_argument("--flats", type=int, default=600, metavar="N")
    parser.add_argument("--rooms", type=int, default=1000, metavar="N")
    parser.add_argument("--built-in", type=int, default=200, metavar="N")
    parser.add_argument("--draws", type=Path, metavar="DIR", help="keep what was made of scenes there, to go on from")
    asked = parser.parse_args()
    counts = {"flats": asked.flats, "rooms": asked.rooms, "built_in": asked.built_in}
    main(asked.judge, asked.out, asked.band, counts, asked.draws)
