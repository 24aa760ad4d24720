"""`python -m ecm.cli`: the same as the command `ecm`."""

from ecm.cli import main

main()
