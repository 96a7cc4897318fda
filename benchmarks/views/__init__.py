"""What benchmarks look at: buildings and rooms, models drawn from scans, scans as files; and how objects are scored."""
