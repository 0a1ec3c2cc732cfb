"""``python -m shjax``."""

from shjax.cli import main

main()
