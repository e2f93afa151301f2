"""Copies the shipped problems into the package when a wheel is built; else see pyproject.toml."""

from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

FOLDERS = ("domains", "instances")


class BuildWithProblems(build_py):
    """Adds `domains` and `instances` as `mdpo_rddl/shipped`, but to an editable install."""

    def run(self) -> None:
        """Builds the package."""
        super().run()
        if self.editable_mode:
            return
        for folder in FOLDERS:
            target = Path(self.build_lib) / "mdpo_rddl" / "shipped" / folder
            target.mkdir(parents=True, exist_ok=True)
            for path in Path(folder).glob("*.rddl"):
                self.copy_file(str(path), str(target / path.name))


setup(cmdclass={"build_py": BuildWithProblems})
