"""`python -m benchmarks`: the measurements that the project reports."""

from mdpo_rddl.cli.importing import ended_at_once

with ended_at_once():
    from benchmarks.main import main
    from mdpo_rddl.cli.ending import without_waiting

raise SystemExit(without_waiting(main()))
