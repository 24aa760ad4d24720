"""What is done with each program that reads an export: `run(folder)` yields lines of results."""
