"""Runs `python -m tactile_viewgcn`, which is the same as the console script `tactile-viewgcn`."""

from tactile_viewgcn.cli import main

main()
