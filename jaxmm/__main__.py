"""`python -m jaxmm`: the command line."""

import sys

from jaxmm.commands.cli import main

if __name__ == "__main__":
    sys.exit(main())
