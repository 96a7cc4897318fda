"""Warp device code, by what it works on. May import: scenes."""
