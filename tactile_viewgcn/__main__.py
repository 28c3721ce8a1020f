"""`python -m tactile_viewgcn`, the same as the console script `tactile-viewgcn`."""

from tactile_viewgcn.cli import main

main()
