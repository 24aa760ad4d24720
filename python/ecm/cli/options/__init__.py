"""The options of the commands: what help and parsing need, and nothing more."""
