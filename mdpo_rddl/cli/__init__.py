"""The commands: argument parsing, calls and output."""
