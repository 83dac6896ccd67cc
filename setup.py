"""Shim for colcon, which calls setup.py; every setting is in pyproject.toml."""

from setuptools import setup

distribution = setup()
# colcon reads this object back through repr(): a SpecifierSet does not survive that, a string does.
version_range = str(distribution.python_requires)
distribution.python_requires = distribution.metadata.python_requires = version_range
