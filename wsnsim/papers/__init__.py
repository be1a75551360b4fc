"""One file a source paper: its published numbers, and which set-up they belong to. Imports nothing heavy."""
