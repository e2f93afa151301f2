"""Runs and scores planners as the 2023 planning competition did."""
