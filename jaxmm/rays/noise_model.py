"""How ranges err: a standard deviation that may grow with the range, and a share of gross errors.

N ranges. Metres.

The ranges are taken for a mixture, as of Hodge and Austin (2004, section 3) and of the beam models of robots (Thrun et
al. 2005, section 6.3): most err normally, with a deviation that is constant, or grows with the range or its square, in
part or wholly; the rest are gross errors, and may be off by anything. Of all shapes of the growth the likeliest is
taken, each with its own deviation and shares of gross errors, which expectation and maximization find.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import erf

MOST_OFF = 0.5  # [m] farther off, a range tells nothing: something changed, or stands before it
LEAST_COSINE = 0.3  # of the incidence of rays that tell
MOST_SHIFT = 0.1  # [m] that ranges may be off to one side because the pose is; more is a change
HEAPS = 6.0  # times the median deviation from the nearer of two heaps of ranges, that these are apart
POWERS = (1, 2)  # of the range, that it may grow with
DOUBLED = (
    0.0,
    0.05,
    0.15,
    0.3,
    0.45,
    0.6,
    0.8,
    1.0,
)  # shares of the ranges up to the one at which it is twice what it is near by
BANDS = 8  # of ranges, each with its own share of gross errors: plants are far, and clutter is near
LIKELIER = 5.0  # logarithm of the likelihood by which a growth must be better than none
ROUNDS, ENOUGH = 40, 1e-3  # of expectation and maximization, at most, and change of the deviation that ends them
MOST_ASKED = 2000  # ranges, or up to twice as many: they tell a deviation to a thirtieth
WHOLE = 9.0  # standard deviations within which all errors are, to the last bit of a double
LEAST_CUT = 0.3  # standard deviations up to which errors are asked, at least: fewer tell nothing of it
LEAST_SIGMA = 1e-6  # [m] of exact ranges
LEAST_FAR = 20  # ranges that tell how far off they are known, and
FARTHER = 3.0  # times as far as that: beyond, nobody knows how the deviation grows


class Noise(NamedTuple):
    """The standard deviation at range r is `constant` + `linear` r + `quadratic` r^2, up to r = `farthest`."""

    constant: float  # [m]
    linear: float = 0.0
    quadratic: float = 0.0  # [1/m]
    farthest: float = np.inf  # [m] from where on it is taken to be as it is there
    gross: float = 0.0  # share of the ranges that are gross errors, or what changed


EXACT = Noise(0.0)


def noise_of(residual: np.ndarray, cosine: np.ndarray, reach: np.ndarray) -> Noise:
    """The noise of measured less expected ranges, of rays that mostly meet what they should.

    Where their own median is farther off than a pose may be, as of a wall that moved and fills the view, deviations
    count from there; of what stayed, which may be nearly half of them, from none.

    Args:
        residual: (N,) [m], NaN or infinite where nothing is known.
        cosine: (N,) of the incidence.
        reach: (N,) expected ranges [m].
    """
    near = np.isfinite(residual) & (np.abs(residual) < MOST_OFF) & (cosine > LEAST_COSINE) & np.isfinite(reach)
    near = np.flatnonzero(near)
    if not len(near):
        return EXACT
    near = near[:: max(1, len(near) // MOST_ASKED)]
    middle = float(np.median(residual[near]))
    off, reach = np.abs(residual[near]).astype(np.float64), np.asarray(reach[near], np.float64)
    if abs(middle) > MOST_SHIFT:
        there = np.abs(residual[near] - middle)
        either = np.minimum(off, there)
        off = either if float(np.median(either)) <= abs(middle) / HEAPS else there
    order = np.argsort(reach)
    bands = np.empty(len(reach), int)
    bands[order] = np.arange(len(reach)) * BANDS // len(reach)
    far = reach[order]
    best = constant = _mixture(off, np.ones(len(off)), bands, np.full(BANDS, 0.1))
    noise, least = Noise(constant.sigma), constant.likelihood + LIKELIER
    for power in POWERS:
        for share in DOUBLED:
            # Of the first, all grows: near by, there is nothing else.
            twice = far[int(share * (len(far) - 1))] if share else 0.0
            grown = 1.0 / np.mean(reach**power) if not share else twice**-power
            tried = _mixture(off, (1.0 if share else 0.0) + grown * reach**power, bands, constant.gross)
            if tried.likelihood > max(least, best.likelihood):
                grown *= tried.sigma
                best = tried
                noise = Noise(tried.sigma if share else 0.0, *(grown if one == power else 0.0 for one in POWERS))
    if best.sigma <= LEAST_SIGMA:
        return EXACT
    told = np.sort(reach[best.normal])
    farthest = FARTHER * float(told[-min(LEAST_FAR, len(told))]) if len(told) else np.inf
    return noise._replace(farthest=farthest, gross=float(best.gross.mean()))


def sigma_at(noise: Noise, reach: np.ndarray) -> np.ndarray:
    """Standard deviation (N,) [m] of ranges of some lengths (N,) [m]; infinite ones count as none."""
    reach = np.minimum(np.where(np.isfinite(reach), reach, 0.0), noise.farthest)
    return noise.constant + noise.linear * reach + noise.quadratic * np.square(reach)


class _Mixture(NamedTuple):
    """Normal errors of one shape, and gross ones."""

    likelihood: float  # its logarithm
    sigma: float  # [m] where the shape is 1
    gross: np.ndarray  # (BANDS,) shares
    normal: np.ndarray  # (N,) bool: likelier normal than gross


def _mixture(off: np.ndarray, shape: np.ndarray, bands: np.ndarray, gross: np.ndarray) -> _Mixture:
    """The likeliest mixture of errors (N,) [m], of which the normal ones grow as a shape (N,), in bands (N,) int.

    It begins with the given shares of gross errors (BANDS,).
    """
    sigma = max(1.4826 * float(np.median(off / shape)), LEAST_SIGMA)
    square, size = np.square(off / shape), np.maximum(np.bincount(bands, minlength=BANDS), 1)
    for _ in range(ROUNDS):
        # Only what is less than MOST_OFF off was asked: where they err by as much, it is the middle of them.
        cut = np.maximum(MOST_OFF / (sigma * shape), LEAST_CUT)
        # So far out, both of the below are 1 to the last bit.
        is_whole = cut.min(initial=np.inf) >= WHOLE
        inside = 1.0 if is_whole else erf(cut / np.sqrt(2.0))
        density = np.sqrt(2.0 / np.pi) / (sigma * shape) * np.exp(-0.5 * square / sigma**2) / inside
        normal = (1.0 - gross)[bands] * density
        total = normal + gross[bands] / MOST_OFF
        weight = normal / total
        # Of the variance, within the cut.
        left = 1.0 if is_whole else 1.0 - cut * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * np.square(cut)) / inside
        before, sigma = sigma, float(np.sqrt((weight * square).sum() / max((weight * left).sum(), 1e-12)))
        sigma = max(sigma, LEAST_SIGMA)
        gross = np.clip(1.0 - np.bincount(bands, weight, BANDS) / size, 1e-6, 1.0)
        if abs(sigma - before) < ENOUGH * sigma:
            break
    return _Mixture(float(np.log(total).sum()), sigma, gross, weight > 0.5)
