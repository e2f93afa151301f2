"""The tasks that are named on the command line."""

from benchmarks.tasks.trial import Task
from mdpo_rddl.problem.files import looks_like_file, read_problem
from mdpo_rddl.problem.repository import named_instance
from mdpo_rddl.problem.shipped import shipped_names


def named_task(name: str) -> Task:
    """A problem and its instance.

    Args:
      name: "Problem", for the first instance that rddlrepository lists, or "Problem:instance"; a
        shipped problem; or "domain.rddl:instance.rddl", or a file that holds both.

    Raises:
      InputError: if there is no such problem, instance or file.
    """
    if name in shipped_names():
        return Task(name)
    domain, colon, instance = name.rpartition(":")
    if not colon:
        domain, instance = name, ""
    if not looks_like_file(domain):
        return Task(*named_instance(name))
    read_problem(domain, instance or None)
    return Task(domain, instance)
