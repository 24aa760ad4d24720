"""`python -m ecm`: the same as the command `ecm`."""

from ecm.cli import main

if __name__ == "__main__":  # not in a process that is spawned
    main()
