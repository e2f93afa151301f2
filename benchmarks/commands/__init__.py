"""The subcommands of `python -m benchmarks`, and their options."""
