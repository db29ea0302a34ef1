"""For colcon, which builds ament_python packages with it. All that is said of the package is in pyproject.toml."""

from typing import Any

from setuptools import setup
from setuptools.dist import Distribution


class Told(Distribution):
    """colcon takes what setuptools knows over as text, and stumbles over a version range that is none."""

    def parse_config_files(self, *args: Any, **kwargs: Any) -> None:
        """Read pyproject.toml and setup.cfg."""
        super().parse_config_files(*args, **kwargs)
        for owner in (self, self.metadata):
            owner.python_requires = str(owner.python_requires)


setup(distclass=Told)
