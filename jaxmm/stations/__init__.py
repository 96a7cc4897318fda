"""Many scans of one building, station by station, on all cores. May import: root, formats, rays, learning, data,
objects, deviations, verdicts."""
