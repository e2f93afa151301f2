"""Where the commands begin: Ctrl-C ends them quietly before their imports are done.

The modules of the commands are imported where each begins, so that hardly anything comes before.
"""

# PYTHON_ARGCOMPLETE_OK

from mdpo_rddl.cli.importing import ended_at_once


def plan() -> int:
    """`mdpo-plan`."""
    with ended_at_once():
        from mdpo_rddl.cli.ending import without_waiting
        from mdpo_rddl.cli.plan import main
    return without_waiting(main())


def ipc() -> int:
    """`mdpo-ipc`."""
    with ended_at_once():
        from mdpo_rddl.cli.ending import without_waiting
        from mdpo_rddl.cli.ipc import main
    return without_waiting(main())


def report() -> int:
    """`mdpo-report`."""
    with ended_at_once():
        from mdpo_rddl.cli.ending import without_waiting
        from mdpo_rddl.cli.report import main
    return without_waiting(main())
