"""`python -m iswarm_mj`, the same as `iswarm`."""

from iswarm_mj.cli import main

main()
