"""The loop in a browser: a server of this machine only, over a session folder of ordinary files.

journal    the steps of a session, appended to one file; undo and redo are records, too
session    the folder: its tables, models and results, and the state that the page shows
steps      each step as a command line of `ecm`
jobs       commands in a process of their own: progress, cancel, interrupted ones
views      what the page draws: kept as files, computed in another process
view_data  what each of them holds
guard      who may ask: token, Host, Origin, and the headers of every answer
server     the routes
"""
