"""Measurements that the project reports, each a command that anyone can run again."""
