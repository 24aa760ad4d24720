"""The loop in a browser: a server of this machine only, over a session folder of ordinary files.

journal    the steps of a session, appended to one file; undo and redo are records, too
session    the folder: its tables, models and results
steps      each step as a command line of `ecm`
jobs       commands in a process of their own: progress, cancel, interrupted ones
views      what the page shows: the state of a session, the readings of a simulated rig while they
           come, and what it draws, kept as files and computed in another process
server     who may ask, the routes, and the server on this machine only
"""
