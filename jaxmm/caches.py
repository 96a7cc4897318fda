"""Where the source tree is."""

from pathlib import Path

TREE = Path(__file__).resolve().parents[1]  # of the sources; where jaxmm is installed, its site-packages
