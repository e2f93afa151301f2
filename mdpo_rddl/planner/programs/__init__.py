"""Compiled programs: rewritten to be faster, and kept on disk."""
