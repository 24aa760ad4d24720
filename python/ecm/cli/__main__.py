"""`python -m ecm.cli`: the same as the command `ecm`."""

from ecm.cli.main import main

main()
