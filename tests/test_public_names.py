"""What a user imports from the package itself."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import mdpo_rddl


@pytest.mark.parametrize("name", mdpo_rddl.__all__)
def test_a_public_name_is_there_and_bears_its_name(name):
    assert getattr(mdpo_rddl, name).__name__ == name


def test_type_checkers_read_the_same_names():
    tree = ast.parse(Path(mdpo_rddl.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    statements = {
        (f"mdpo_rddl.{module}", name)
        for module, names in mdpo_rddl._SOURCES.items()
        for name in names
    }
    read = {(node.module, alias.name) for node in block.body for alias in node.names}
    assert read == statements
    assert sorted(name for _, name in read) == sorted(mdpo_rddl.__all__)


def test_what_is_not_there_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'mdpo_rddl' has no attribute 'MDPOPlaner'"):
        mdpo_rddl.MDPOPlaner  # noqa: B018
    assert set(mdpo_rddl.__all__) <= set(dir(mdpo_rddl))


def test_the_package_alone_imports_nothing_large():
    code = "import sys, mdpo_rddl; print({'jax', 'pyRDDLGym', 'numpy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
