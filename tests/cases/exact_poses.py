"""Detection of scans whose poses are right, and no more than that: what several test files share."""

from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.settings import DetectSettings

AS_IS = DetectSettings(refine=False, propose_views=False)


def named(scan, file="scan"):
    return NamedScan(scan, file, len(scan.points), "given")
