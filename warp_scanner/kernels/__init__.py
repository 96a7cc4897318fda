"""Warp device code only, by what it works on. Imports scenes, for their constants."""
