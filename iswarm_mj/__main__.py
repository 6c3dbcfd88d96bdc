"""`python -m iswarm_mj`, the same as `iswarm`."""

from iswarm_mj.commands.main import main

main()
