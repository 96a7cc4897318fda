"""Scan files in; points, poses and unseen rays out, and back. May import: root."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "poses": ["GivenPose", "parse_pose", "read_poses"],
        "readers": ["PointScan", "read_scans"],
        "writers": ["SensorScan", "write_scan"],
    },
)
