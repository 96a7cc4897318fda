"""Cases and builders that several test files share: rooms, buildings, files and detections whose answers are known."""
