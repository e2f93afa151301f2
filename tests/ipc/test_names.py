"""An entry's folder lies in the results folder, whatever the files of the problem are called."""

from pathlib import Path

import pytest

from mdpo_rddl.ipc.rules import Entry, Instance


@pytest.mark.parametrize("file", ["./...rddl", "..rddl", "p/....rddl", "./.rddl", "./a b.rddl"])
def test_no_file_s_name_leads_out_of_the_results(file: str, tmp_path: Path) -> None:
    root = tmp_path / "out"
    folder = Entry(Instance(file, file), "noop").folder(root)
    assert folder.resolve().relative_to(root).parts[-1] == "noop"
    assert len(folder.resolve().relative_to(root).parts) == 3


def test_labels_are_the_files_names() -> None:
    problem = Instance("d/tanks.rddl", "i/two.rddl")
    assert (problem.domain_label, problem.label) == ("tanks", "two")
