"""Tasks as the command line names them."""

import pytest
from helpers.tanks import DOMAIN, INSTANCE, write

from benchmarks.tasks.naming import named_task
from benchmarks.tasks.trial import Task
from mdpo_rddl.errors import InputError


def test_problems_of_rddlrepository_and_shipped_ones():
    assert named_task("hvac10") == Task("hvac10")
    assert named_task("UAV_ippc2023") == Task("UAV_ippc2023", "1")
    assert named_task("UAV_ippc2023:5") == Task("UAV_ippc2023", "5")


def test_files(tmp_path):
    domain, instance = write(tmp_path)
    assert named_task(f"{domain}:{instance}") == Task(domain, instance)
    both = tmp_path / "both.rddl"
    both.write_text(DOMAIN + INSTANCE)
    assert named_task(str(both)) == Task(str(both))


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Toy", "no problem 'Toy'"),
        ("TSP_or:9", "no instance '9' of TSP_or"),
        (":1", "no problem ''"),
        ("none.rddl:one.rddl", "none.rddl: cannot read the domain file"),
        ("none.rddl", "none.rddl: cannot read the domain file"),
    ],
)
def test_what_there_is_not_is_told(name, said):
    with pytest.raises(InputError, match=said):
        named_task(name)
